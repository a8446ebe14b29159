// Do events and IMU go by one clock? Both tell of the camera's motion: turning faster makes more events.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// Compares the rate of events with the angular rate over the first ten minutes of a recording.
class ClockCheck {
 public:
  void add(const Packet& packet);

  struct Offset {
    double seconds = 0;    ///< t_imu = t_camera + seconds; good to about 0.1 s
    double match = 0;      ///< correlation of the two rates at this offset
    double runner_up = 0;  ///< the best one at offsets that are clearly others
    /// Far enough from chance to be acted upon.
    [[nodiscard]] bool certain() const { return match > 0.4 && match - runner_up > 0.15; }
  };
  /// The offset within 1 s at which the two agree best; nothing for less than 3 s of both.
  [[nodiscard]] std::optional<Offset> offset() const;

 private:
  struct Bin {
    std::int64_t events = 0, samples = 0;
    double rate_sum = 0;  // [rad/s]
  };
  Bin* bin_of(Time t);

  std::optional<Time> origin_;
  std::vector<Bin> bins_;
};

}  // namespace idol
