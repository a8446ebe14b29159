// A sensor's own clock, which wraps, beside the stamps of the messages that carry it.
#pragma once

#include <cstdint>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// Where the clock of evt3 (24 bits of microseconds) lies to ROS time: the median over many messages, since a
/// single one may be stamped late, or before the host's clock was set.
class SensorClock {
 public:
  static constexpr Time kWrap = Time{1 << 24} * 1000;  ///< [ns]

  /// A message's stamp and the sensor's time at which it begins [us].
  void add(Time stamp, std::int64_t sensor_us);
  [[nodiscard]] bool known() const { return !offsets_.empty(); }
  /// Of the ROS times that a time of the sensor may mean, one a wrap, the nearest to `stamp`: messages that
  /// were lost, however many, leave their gap.
  [[nodiscard]] Time ros_time(std::int64_t sensor_us, Time stamp) const;

  struct Disagreement {
    std::int64_t messages = 0;  ///< stamped more than 50 ms from where the others are
    double most_s = 0;
  };
  [[nodiscard]] Disagreement disagreement() const;

 private:
  [[nodiscard]] Time offset() const;

  Time reference_ = 0;         // offset by the first message [ns]
  std::vector<Time> offsets_;  // by each, from that one and within half a wrap of it
};

}  // namespace idol
