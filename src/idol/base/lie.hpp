// SO(3) and SE(3) with right perturbations: R * Exp(dtheta), full angle. Forster et al. 2017, eqs. 3-11.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace idol {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Quat = Eigen::Quaterniond;
// Eigen lays its types out by the instruction set: with AVX (-march=native) whoever includes this would see
// other structs than idol, and Ceres below it, were built with.
static_assert(alignof(Quat) <= 16, "compile without AVX (-march=native), or with -DEIGEN_MAX_ALIGN_BYTES=16");

/// Cross-product matrix: hat(a) * b = a x b.
inline Mat3 hat(const Vec3& a) {
  Mat3 m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

/// Unit quaternion of a rotation vector [rad].
inline Quat quat_exp(const Vec3& theta) {
  const double angle2 = theta.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double k = angle2 < 1e-12 ? 0.5 - angle2 / 48.0 : std::sin(0.5 * angle) / angle;
  return {std::cos(0.5 * angle), k * theta.x(), k * theta.y(), k * theta.z()};
}

/// Rotation vector of a unit quaternion, angle in [0, pi].
inline Vec3 quat_log(const Quat& q) {
  const double sign = q.w() < 0 ? -1.0 : 1.0;
  const double n2 = q.vec().squaredNorm();
  const double w = sign * q.w();
  if (n2 < 1e-16) return sign * (2.0 / w) * q.vec();
  const double n = std::sqrt(n2);
  return sign * (2.0 * std::atan2(n, w) / n) * q.vec();
}

/// Rotation matrix of a rotation vector [rad].
inline Mat3 so3_exp(const Vec3& theta) {
  const double angle2 = theta.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double a = angle2 < 1e-12 ? 1.0 - angle2 / 6.0 : std::sin(angle) / angle;
  const double b = angle2 < 1e-8 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const Mat3 W = hat(theta);
  return Mat3::Identity() + a * W + b * W * W;
}

/// Rotation vector of a rotation matrix, angle in [0, pi].
inline Vec3 so3_log(const Mat3& R) { return quat_log(Quat(R)); }

/// Third component of the cross product.
inline double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Right Jacobian: Exp(theta + d) ~ Exp(theta) Exp(Jr(theta) d).
inline Mat3 right_jacobian(const Vec3& theta) {
  const double angle2 = theta.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double a = angle2 < 1e-8 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const double b = angle2 < 1e-6 ? 1.0 / 6.0 - angle2 / 120.0 : (angle - std::sin(angle)) / (angle2 * angle);
  const Mat3 W = hat(theta);
  return Mat3::Identity() - a * W + b * W * W;
}

/// Inverse of the right Jacobian: Log(Exp(theta) Exp(d)) ~ theta + Jr^-1(theta) d.
inline Mat3 right_jacobian_inverse(const Vec3& theta) {
  const double angle2 = theta.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double b = angle2 < 1e-6
                       ? 1.0 / 12.0 + angle2 / 720.0
                       : 1.0 / angle2 - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
  const Mat3 W = hat(theta);
  return Mat3::Identity() + 0.5 * W + b * W * W;
}

/// Rigid transformation T_a_b: x_a = R * x_b + p.
struct Pose {
  Quat q = Quat::Identity();
  Vec3 p = Vec3::Zero();

  [[nodiscard]] Mat3 R() const { return q.toRotationMatrix(); }
  [[nodiscard]] Pose inverse() const { return {q.conjugate(), -(q.conjugate() * p)}; }
  Pose operator*(const Pose& o) const { return {(q * o.q).normalized(), q * o.p + p}; }
  Vec3 operator*(const Vec3& x) const { return q * x + p; }
};

/// Interpolation between two poses: linear in position, geodesic in rotation. alpha in [0, 1].
inline Pose interpolate(const Pose& a, const Pose& b, double alpha) {
  return {a.q.slerp(alpha, b.q), (1.0 - alpha) * a.p + alpha * b.p};
}

}  // namespace idol
