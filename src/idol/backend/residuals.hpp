// The paper's residuals (IV) as pure functions with analytic Jacobians; no solver in sight.
// Tangent order of a state: [p, theta, v, b_g, b_a], rotation perturbed on the right: R Exp(dtheta).
#pragma once

#include <Eigen/Core>
#include <optional>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol {

using RowVec3 = Eigen::Matrix<double, 1, 3>;
using StateRow = Eigen::Matrix<double, 1, 15>;
using LineRow = Eigen::Matrix<double, 1, 6>;

/// An event with what the IMU says about its time: undistorted pixel and motion since the window's begin.
struct EventMeasurement {
  Vec2 px = Vec2::Zero();
  Preintegrated motion;
};

/// A 3D segment by its two ends in the world (paper eq. 2).
struct LineEnds {
  Vec3 a = Vec3::Zero();
  Vec3 b = Vec3::Zero();
};

/// What the event factors need besides states: how to get from the world into the image.
struct Projection {
  Camera camera;
  Pose T_i_c;
  Vec3 gravity = Vec3(0, 0, -9.81);  ///< [m/s^2]
};

/// A point of projective space, x / w in the world; w = 0 is at infinity.
struct HomogeneousPoint {
  Vec3 x = Vec3::Zero();
  double w = 1;
};

/// A point in the camera at an event's time, up to its scale (w x_c), with Jacobians.
struct PointInCamera {
  Vec3 x = Vec3::Zero();
  Eigen::Matrix<double, 3, 15> d_x_d_state = Eigen::Matrix<double, 3, 15>::Zero();
  Mat3 d_x_d_point = Mat3::Zero();  ///< to HomogeneousPoint::x
};

/// The camera at one time, from the state at the window's begin: x_c = T_i_c^-1 T_w_i(t)^-1 x_w with T_w_i(t)
/// from paper eq. 4. What does not depend on the point is computed once.
class TimedCamera {
 public:
  /// `linearised_at`: biases of the preintegration.
  TimedCamera(const NavState& state, const Preintegrated& motion, const ImuBias& linearised_at,
              const Projection& projection);
  [[nodiscard]] PointInCamera operator()(const HomogeneousPoint& point) const;

  /// Without the state's Jacobian, which all points at one time share: the derivative r of a residual to a
  /// point's x reaches the state by [w r R_c_0, (r R_c_0) x seen_from_start(point)] by_state(). Summed over a
  /// residual's points first, these are six numbers instead of 16.
  [[nodiscard]] Vec3 at(const HomogeneousPoint& point) const { return R_c_w_ * point.x + point.w * d_x_d_w_; }
  [[nodiscard]] Vec3 seen_from_start(const HomogeneousPoint& point) const {
    return R_0_w_ * (point.x - point.w * origin_);
  }
  [[nodiscard]] const Mat3& R_c_0() const { return R_c_0_; }
  [[nodiscard]] const Mat3& R_c_w() const { return R_c_w_; }
  [[nodiscard]] const Vec3& d_x_d_w() const { return d_x_d_w_; }
  /// To [p, theta, v, b_g, b_a, time].
  [[nodiscard]] const Eigen::Matrix<double, 6, 16>& by_state() const { return by_state_; }

 private:
  Mat3 R_c_0_, R_c_w_, R_0_w_;  // 0: the IMU at the window's begin
  Vec3 origin_, d_x_d_w_;
  Eigen::Matrix<double, 6, 16> by_state_;
};

/// Image of the line through two points of the camera frame, by the plane through them and the camera's
/// centre: its normal is x_a x x_b. Right also where an end is behind the camera.
class ImageLine {
 public:
  /// nullopt when the normal vanishes.
  static std::optional<ImageLine> through(const Vec3& a, const Vec3& b, const Camera& camera);

  struct Distance {
    double value = 0;        ///< signed [px]
    RowVec3 d_a, d_b;        ///< to the two points
    double d_log_focal = 0;  ///< to the log of both focal lengths
  };
  /// Of an undistorted pixel.
  [[nodiscard]] Distance distance(const Vec2& px) const;
  /// The value alone.
  [[nodiscard]] double signed_distance(const Vec2& px) const { return n_.dot(ray(px)) / h_; }
  /// Unit, to where distances grow.
  [[nodiscard]] Vec2 normal() const { return Vec2(n_.x() / camera_.fx, n_.y() / camera_.fy) / h_; }

 private:
  [[nodiscard]] Vec3 ray(const Vec2& px) const { return camera_.normalise(px).homogeneous(); }

  Vec3 a_, b_, n_, d_h_;
  double h_ = 0;  // length of the normal of the line in the image
  Camera camera_;
};

/// One row: value [px], Jacobians.
struct LineResidual {
  double value = 0;
  StateRow d_state = StateRow::Zero();
  LineRow d_line = LineRow::Zero();
  bool valid = false;
};

/// Signed distance of an event from the projected line [px] (paper IV-A, ImageLine): equal to the paper's
/// cross product in the image. Invalid when there is no image line.
LineResidual event_to_line(const EventMeasurement& event, const PointInCamera& a, const PointInCamera& b,
                           const Camera& camera);

/// Distance along the line by which an event lies beyond the nearer end [px], zero in between (paper IV-B).
/// Zero and valid = false when an end is not in front of the camera.
LineResidual repulsion(const EventMeasurement& event, const PointInCamera& a, const PointInCamera& b,
                       const Camera& camera);

/// Square root of the projected length [sqrt px] (paper IV-B). Invalid when an end is not in front of the
/// camera.
LineResidual attraction(const PointInCamera& a, const PointInCamera& b, const Camera& camera);

/// IMU residual [p, R, v] between two states (paper IV-C; order of rows as our tangent order), unwhitened.
struct ImuResidual {
  Eigen::Matrix<double, 9, 1> value;
  Eigen::Matrix<double, 9, 15> d_from, d_to;
};
ImuResidual imu_residual(const NavState& from, const NavState& to, const Preintegrated& motion,
                         const ImuBias& linearised_at, const Vec3& gravity);

/// Change of the biases [gyro, accelerometer] between two windows (paper IV-C), unwhitened; its Jacobians are
/// -I and I.
Eigen::Matrix<double, 6, 1> bias_residual(const ImuBias& from, const ImuBias& to);

}  // namespace idol
