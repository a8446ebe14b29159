#include "idol/estimation/imu_intrinsics.hpp"

namespace idol {

ImuIntrinsics uncalibrated_imu_sigma() {
  constexpr double kScale = 0.01;      // also of an axis across another [rad]
  constexpr double kByForce = 1.8e-4;  // [rad/s per m/s^2]
  ImuIntrinsics out;
  out << Eigen::Matrix<double, 9 + 6, 1>::Constant(kScale), Eigen::Matrix<double, 9, 1>::Constant(kByForce);
  return out;
}

BiasByIntrinsics bias_by_intrinsics(const Preintegrated& motion) {
  const Vec3 turn = so3_log(motion.dR);
  const Vec3 rate = turn / motion.dt, force = so3_exp(-0.5 * turn) * motion.dv / motion.dt;
  BiasByIntrinsics out = BiasByIntrinsics::Zero();
  Eigen::Index triangle = 9;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    out.block<1, 3>(axis, 3 * axis) = rate.transpose();
    out.block(3 + axis, triangle, 1, axis + 1) = force.head(axis + 1).transpose();
    triangle += axis + 1;
    out.block<1, 3>(axis, 15 + 3 * axis) = force.transpose();
  }
  return out;
}

}  // namespace idol
