// Do the gyro's rates turn the camera as the lines in the image say? If not, do they along other axes, or in
// another unit?
#pragma once

#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/odometry/odometry.hpp"

namespace idol {

/// Over the first 20 s with lines in view.
class GyroImageCheck {
 public:
  GyroImageCheck(const Rig& rig, const UndistortMap& undistort) : rig_(rig), undistort_(undistort) {}

  /// In the thread that pushes.
  void add(const ImuSample& sample);
  /// In the thread that estimates.
  void add(const Estimate& estimate);
  /// Once both are over: `gyro_axes`, `gyro_unit`.
  void report(Diagnostics& diagnostics) const;

 private:
  /// How the camera turns in a window, by what the image shows.
  struct Turn {
    Time begin = 0, end = 0;
    Vec3 omega = Vec3::Zero();  ///< [rad/s], in the camera
  };
  [[nodiscard]] Vec3 mean_rate(Time begin, Time end) const;

  const Rig& rig_;
  const UndistortMap& undistort_;
  std::vector<ImuSample> samples_;
  std::vector<Turn> turns_;
};

}  // namespace idol
