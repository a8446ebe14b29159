// Ceres wrappers of the residuals. Parameter blocks:
//   pose  7  [p, q(x y z w)]   on PoseManifold (or TiltManifold for the gauge)
//   motion 9 [v, b_g, b_a]     line 6 [a, b] in the world, on LineManifold
#pragma once

#include <ceres/cost_function.h>
#include <ceres/manifold.h>

#include <memory>
#include <span>

#include "idol/backend/residuals.hpp"

namespace idol {

constexpr int kPoseSize = 7;
constexpr int kMotionSize = 9;
constexpr int kLineSize = 6;

/// The solver's copy of a state.
struct StateParameters {
  Eigen::Matrix<double, kPoseSize, 1> pose;
  Eigen::Matrix<double, kMotionSize, 1> motion;
};
StateParameters to_parameters(const NavState& state);
/// The quaternion is normalised, so that derivatives off the unit sphere make sense.
NavState from_parameters(const double* pose, const double* motion);

/// p + dp, q * Exp(dtheta).
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// The gauge of the first pose: position fixed, rotation about the world's x and y axes only: Exp([d, 0]) *
/// q.
class TiltManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kPoseSize; }
  int TangentSize() const override { return 2; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

/// Steps of a line's two ends in bearing and inverse depth seen from a fixed camera: projections are nearly
/// linear in them, however little is known of the depth. The line itself stays two 3D points (paper eq. 2).
class LineManifold : public ceres::Manifold {
 public:
  explicit LineManifold(const Pose& T_w_c) : T_w_c_(T_w_c) {}
  int AmbientSize() const override { return kLineSize; }
  int TangentSize() const override { return kLineSize; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;

 private:
  Pose T_w_c_;
};

struct LineNoise {
  double event_px = 1.5;      ///< standard deviation of an event's distance
  double huber_sigmas = 1.5;  ///< beyond: absolute instead of squared; 0 = squared throughout (the paper)
  double repulsion_px = 10;
  double attraction = 10;  ///< [sqrt px]
};

/// Two rows an event: distance and repulsion (paper IV-A, IV-B). `events` must outlive the cost. Blocks:
/// pose, motion, line.
std::unique_ptr<ceres::CostFunction> event_line_cost(std::span<const EventMeasurement> events,
                                                     const ImuBias& linearised_at,
                                                     const Projection& projection, const LineNoise& noise);
/// Attraction in the window that first saw the line (paper IV-B). Blocks: pose, motion, line.
std::unique_ptr<ceres::CostFunction> attraction_cost(const Preintegrated& motion,
                                                     const ImuBias& linearised_at,
                                                     const Projection& projection, const LineNoise& noise);
/// Weak knowledge of a new line's depth: log depth of both ends about log `depth_m`, and equal depths, seen
/// from a fixed camera pose. Block: line.
std::unique_ptr<ceres::CostFunction> depth_prior_cost(const Pose& T_w_c, double depth_m, double sigma_log,
                                                      double sigma_slant);
/// Keeps the ends from sliding along the line by more than about `sigma_m` in one solve. The attraction's
/// residual is a square root, whose Gauss-Newton step runs to minus the line's length unless events oppose
/// it; this vanishes at a fixed point, so it changes where solves begin and not where they end. Block: line.
std::unique_ptr<ceres::CostFunction> end_damping_cost(const LineEnds& now, double sigma_m);
/// Blocks: pose, motion of one window, pose, motion of the next. `covariance` of [p, R, v].
std::unique_ptr<ceres::CostFunction> imu_cost(const Preintegrated& motion, const Mat9& covariance,
                                              const ImuBias& linearised_at, const Vec3& gravity);
/// Brownian biases over `dt` seconds (paper IV-C). Blocks: motion, motion.
std::unique_ptr<ceres::CostFunction> bias_walk_cost(const ImuNoise& noise, double dt);
/// Prior on [v, b_g, b_a]. Block: motion.
std::unique_ptr<ceres::CostFunction> motion_prior_cost(const Eigen::Matrix<double, 9, 1>& mean,
                                                       const Eigen::Matrix<double, 9, 1>& sigma);

}  // namespace idol
