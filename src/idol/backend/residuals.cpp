#include "idol/backend/residuals.hpp"

#include <cmath>

namespace idol {
namespace {

constexpr double kMinDepth = 0.02;  // [m], in front of the camera

using Mat23 = Eigen::Matrix<double, 2, 3>;

Mat23 projection_jacobian(const Vec3& x, const Camera& camera) {
  Mat23 J;
  J << camera.fx / x.z(), 0, -camera.fx * x.x() / (x.z() * x.z()), 0, camera.fy / x.z(),
      -camera.fy * x.y() / (x.z() * x.z());
  return J;
}

// d residual / d x_a and d x_b chained to state and line.
void chain(const RowVec3& d_a, const RowVec3& d_b, const PointInCamera& a, const PointInCamera& b,
           LineResidual& r) {
  r.d_state.noalias() = d_a * a.d_x_d_state + d_b * b.d_x_d_state;
  r.d_line << d_a * a.d_x_d_point, d_b * b.d_x_d_point;
}

}  // namespace

// With dR = dR0 Exp(J dbg), u = R^T (x_w - w (p + v dt + g dt^2 / 2)) the point seen from the IMU at the
// begin: x_c = R_c_0 (u - w dp) - w R_c_i p_i_c. u moves with p and v and turns with theta; what turns dR
// turns u - w dp.
TimedCamera::TimedCamera(const NavState& state, const Preintegrated& motion, const ImuBias& linearised_at,
                         const Projection& projection) {
  const Vec3 dbg = state.bias.gyro - linearised_at.gyro;
  const Vec3 dba = state.bias.accel - linearised_at.accel;
  const Vec3 correction = motion.d_R_d_bg * dbg;
  const Mat3 dR = motion.dR * so3_exp(correction);
  const Vec3 dp = motion.dp + motion.d_p_d_bg * dbg + motion.d_p_d_ba * dba;
  const double dt = motion.dt;
  const Mat3 R_c_i = projection.T_i_c.q.conjugate().toRotationMatrix();
  R_0_w_ = state.T_w_i.q.conjugate().toRotationMatrix();
  R_c_0_ = R_c_i * dR.transpose();
  R_c_w_ = R_c_0_ * R_0_w_;
  origin_ = state.T_w_i.p + state.v_w * dt + 0.5 * dt * dt * projection.gravity;
  d_x_d_w_ = -R_c_w_ * origin_ - R_c_0_ * dp - R_c_i * projection.T_i_c.p;

  // Of the whole: dR by the gyro's bias and by time, velocity.
  const Mat3 turn = dR * right_jacobian(correction) * motion.d_R_d_bg;
  const Vec3 rate = dR * (motion.rate - dbg);
  const Vec3 velocity = R_0_w_ * (state.v_w + dt * projection.gravity) + motion.dv + motion.d_v_d_bg * dbg +
                        motion.d_v_d_ba * dba;
  by_state_.setZero();
  by_state_.block<3, 3>(0, 0) = -R_0_w_;
  by_state_.block<3, 3>(0, 6) = -dt * R_0_w_;
  by_state_.block<3, 3>(0, 9) = -hat(dp) * turn - motion.d_p_d_bg;
  by_state_.block<3, 3>(0, 12) = -motion.d_p_d_ba;
  by_state_.block<3, 1>(0, 15) = -dp.cross(rate) - velocity;
  by_state_.block<3, 3>(3, 3).setIdentity();
  by_state_.block<3, 3>(3, 9) = turn;
  by_state_.block<3, 1>(3, 15) = rate;
}

PointInCamera TimedCamera::operator()(const HomogeneousPoint& point) const {
  PointInCamera out;
  out.x = at(point);
  out.d_x_d_point = R_c_w_;
  out.d_x_d_state = point.w * R_c_0_ * by_state_.topLeftCorner<3, 15>() +
                    R_c_0_ * hat(seen_from_start(point)) * by_state_.bottomLeftCorner<3, 15>();
  return out;
}

std::optional<ImageLine> ImageLine::through(const Vec3& a, const Vec3& b, const Camera& camera) {
  ImageLine line;
  line.a_ = a;
  line.b_ = b;
  line.n_ = a.cross(b);
  line.h_ = Vec2(line.n_.x() / camera.fx, line.n_.y() / camera.fy).norm();
  if (!(line.h_ > 1e-9)) return std::nullopt;
  line.d_h_ = {line.n_.x() / (camera.fx * camera.fx * line.h_),
               line.n_.y() / (camera.fy * camera.fy * line.h_), 0};
  line.camera_ = camera;
  return line;
}

ImageLine::Distance ImageLine::distance(const Vec2& px) const {
  Distance out;
  out.value = signed_distance(px);
  const RowVec3 d_n = (ray(px) - out.value * d_h_).transpose() / h_;
  out.d_a = -d_n * hat(b_);
  out.d_b = d_n * hat(a_);
  out.d_log_focal = n_.z() / h_;
  return out;
}

LineResidual event_to_line(const EventMeasurement& event, const PointInCamera& a, const PointInCamera& b,
                           const Camera& camera) {
  LineResidual r;
  const auto line = ImageLine::through(a.x, b.x, camera);
  if (!line) return r;
  const auto distance = line->distance(event.px);
  r.value = distance.value;
  chain(distance.d_a, distance.d_b, a, b, r);
  r.valid = true;
  return r;
}

LineResidual repulsion(const EventMeasurement& event, const PointInCamera& a, const PointInCamera& b,
                       const Camera& camera) {
  LineResidual r;
  if (a.x.z() < kMinDepth || b.x.z() < kMinDepth) return r;
  const Vec2 pa = camera.project(a.x), pb = camera.project(b.x);
  const double length = (pb - pa).norm();
  if (!(length > 1e-6)) return r;
  r.valid = true;
  const Vec2 along = (pb - pa) / length;
  const double d = (event.px - pa).dot(along);
  if (d >= 0 && d <= length) return r;
  // d along / d pb = (I - along along^T) / length: only what the event is off the line turns the direction.
  const Vec2 off = (event.px - pa) - d * along;
  const Vec2 d_pb = off / length;
  const Vec2 d_pa = -along - off / length;
  Vec2 row_a, row_b;
  if (d < 0) {
    r.value = d;
    row_a = d_pa;
    row_b = d_pb;
  } else {
    r.value = length - d;
    row_a = -along - d_pa;
    row_b = along - d_pb;
  }
  chain(row_a.transpose() * projection_jacobian(a.x, camera),
        row_b.transpose() * projection_jacobian(b.x, camera), a, b, r);
  return r;
}

LineResidual attraction(const PointInCamera& a, const PointInCamera& b, const Camera& camera) {
  LineResidual r;
  if (a.x.z() < kMinDepth || b.x.z() < kMinDepth) return r;
  const Vec2 span = camera.project(b.x) - camera.project(a.x);
  const double length = span.norm();
  if (!(length > 1e-6)) return r;
  r.valid = true;
  r.value = std::sqrt(length);
  const Vec2 d_b = span / (2 * length * r.value);
  chain(-d_b.transpose() * projection_jacobian(a.x, camera),
        d_b.transpose() * projection_jacobian(b.x, camera), a, b, r);
  return r;
}

ImuResidual imu_residual(const NavState& from, const NavState& to, const Preintegrated& motion,
                         const ImuBias& linearised_at, const Vec3& gravity) {
  const double dt = motion.dt;
  const Vec3 dbg = from.bias.gyro - linearised_at.gyro;
  const Vec3 dba = from.bias.accel - linearised_at.accel;
  const Vec3 correction = motion.d_R_d_bg * dbg;
  const Mat3 Rt = from.T_w_i.q.conjugate().toRotationMatrix();
  const Vec3 up = Rt * (to.T_w_i.p - from.T_w_i.p - dt * from.v_w - 0.5 * dt * dt * gravity);
  const Vec3 uv = Rt * (to.v_w - from.v_w - dt * gravity);
  const Quat predicted = Quat(motion.dR) * quat_exp(correction);
  const Vec3 error = quat_log(predicted.conjugate() * from.T_w_i.q.conjugate() * to.T_w_i.q);
  const Mat3 Jr_inv = right_jacobian_inverse(error);
  const Mat3 R_to_from = to.T_w_i.q.conjugate().toRotationMatrix() * from.T_w_i.q.toRotationMatrix();

  ImuResidual r;
  r.value << up - (motion.dp + motion.d_p_d_bg * dbg + motion.d_p_d_ba * dba), error,
      uv - (motion.dv + motion.d_v_d_bg * dbg + motion.d_v_d_ba * dba);
  r.d_from.setZero();
  r.d_to.setZero();
  r.d_from.block<3, 3>(0, 0) = -Rt;
  r.d_from.block<3, 3>(0, 3) = hat(up);
  r.d_from.block<3, 3>(0, 6) = -dt * Rt;
  r.d_from.block<3, 3>(0, 9) = -motion.d_p_d_bg;
  r.d_from.block<3, 3>(0, 12) = -motion.d_p_d_ba;
  r.d_to.block<3, 3>(0, 0) = Rt;
  r.d_from.block<3, 3>(3, 3) = -Jr_inv * R_to_from;
  r.d_from.block<3, 3>(3, 9) =
      -Jr_inv * so3_exp(error).transpose() * right_jacobian(correction) * motion.d_R_d_bg;
  r.d_to.block<3, 3>(3, 3) = Jr_inv;
  r.d_from.block<3, 3>(6, 3) = hat(uv);
  r.d_from.block<3, 3>(6, 6) = -Rt;
  r.d_from.block<3, 3>(6, 9) = -motion.d_v_d_bg;
  r.d_from.block<3, 3>(6, 12) = -motion.d_v_d_ba;
  r.d_to.block<3, 3>(6, 6) = Rt;
  return r;
}

Eigen::Matrix<double, 6, 1> bias_residual(const ImuBias& from, const ImuBias& to) {
  Eigen::Matrix<double, 6, 1> r;
  r << to.gyro - from.gyro, to.accel - from.accel;
  return r;
}

}  // namespace idol
