// An IMU that cannot be right, by its own readings: channels that are dead, frozen or cut off, rates in
// another unit or along other axes than the accelerations.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol {

class ImuCheck {
 public:
  /// In time order.
  void add(const ImuSample& sample);
  /// Says what is wrong with stamps counted from `origin`: imu_dead_channel, imu_frozen, imu_clipped,
  /// gyro_unit, gyro_axes.
  void report(Time origin, Diagnostics& diagnostics) const;

 private:
  static constexpr std::size_t kChannels = 6;  // accelerations, then rates
  struct Channel {
    double least = 0, most = 0;
    std::int64_t at_least = 0, at_most = 0;  // samples that repeat the extreme, three in a row and more
    std::int64_t run = 0;                    // of the value now
    double value = 0;

    void add(double v, bool first);
  };
  /// Mean readings of a tenth of a second.
  struct Mean {
    Vec3 accel = Vec3::Zero(), gyro = Vec3::Zero();
    std::int64_t samples = 0;
  };

  void report_channels(Diagnostics& diagnostics) const;
  void report_axes(Diagnostics& diagnostics) const;

  std::int64_t count_ = 0;
  std::array<Channel, kChannels> channels_;
  ImuSample last_;
  Time same_since_ = 0, frozen_at_ = 0, frozen_for_ = 0;
  Time first_ = 0;
  std::vector<Mean> means_;
};

}  // namespace idol
