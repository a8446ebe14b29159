// Errors of an IMU that grow with what it measures: scale, misaligned axes, and rates that specific force
// makes. Beside the true rate w [rad/s] and specific force a [m/s^2] its sensors read
//   gyro:          (I + S_g) w + G a + b_g
//   accelerometer: (I + S_a) a + b_a,  S_a lower triangular: the accelerometer's first axis is the frame's.
// Over a window of some hundredths of a second these errors act as biases, S_g w + G a and S_a a at the mean
// w and a, so that they reach every residual by the bias Jacobians of the preintegration.
#pragma once

#include <Eigen/Core>

#include "idol/imu/preintegration.hpp"

namespace idol {

/// [S_g by rows, S_a by rows of its triangle, G by rows].
constexpr Eigen::Index kImuIntrinsicsDim = 9 + 6 + 9;
using ImuIntrinsics = Eigen::Matrix<double, kImuIntrinsicsDim, 1>;
using BiasByIntrinsics = Eigen::Matrix<double, 6, kImuIntrinsicsDim>;

/// Standard deviations of a MEMS unit that nobody has calibrated: 1 %, 0.6 deg, 0.1 deg/s per g.
ImuIntrinsics uncalibrated_imu_sigma();

/// How the biases [gyro, accelerometer] that act in a window follow the intrinsics; from the window's motion.
BiasByIntrinsics bias_by_intrinsics(const Preintegrated& motion);

}  // namespace idol
