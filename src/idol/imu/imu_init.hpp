// First attitude and gyro bias from the first readings.
#pragma once

#include <span>

#include "idol/base/diagnostics.hpp"
#include "idol/base/options.hpp"
#include "idol/base/types.hpp"

namespace idol {

struct ImuInitOptions {
  double duration_s = 0.8;
  double still_gyro_std = 0.03;
  double still_accel_std = 0.4;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("duration_s", self.duration_s, Range{0.05, 10},
          "IMU data used for the first attitude and gyro bias [s]");
    visit("still_gyro_std", self.still_gyro_std, Range{0, 10},
          "the start counts as still below this spread of the rate [rad/s], 25 ms means");
    visit("still_accel_std", self.still_accel_std, Range{0, 100},
          "and below this spread of the specific force [m/s^2], 25 ms means");
  }
};

struct ImuInit {
  Quat q_w_i = Quat::Identity();  ///< attitude at the first sample; gravity along -z of the world, yaw zero
  ImuBias bias;                   ///< gyro bias if the start is still, else zero; accelerometer bias zero
  bool still = false;
  double gyro_std = 0;   ///< spread of 25 ms means [rad/s]
  double accel_std = 0;  ///< [m/s^2]
};

/// The mean specific force is not gravity's, but may be of a violent motion: a later start may do.
struct ViolentStart : DataError {
  using DataError::DataError;
};

/// Gravity is the mean specific force turned into the frame of the first sample by the gyro. The world's z
/// axis is up; its x axis is the IMU x axis (or, if that is vertical, the y axis) laid flat. Throws DataError
/// on fewer than 10 samples or a mean specific force that no motion explains, ViolentStart on one that is
/// some way from 1 g.
ImuInit initialise_from_imu(std::span<const ImuSample> samples, double gravity,
                            const ImuInitOptions& options);

}  // namespace idol
