#include "idol/backend/anchored_line.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace idol {

LineAnchor LineAnchor::from_image(const Pose& T_w_c, const Vec2& a_px, const Vec2& b_px,
                                  const Camera& camera) {
  LineAnchor out;
  out.T_w_c = T_w_c;
  out.a = camera.normalise(a_px);
  out.b = camera.normalise(b_px);
  const Vec2 along = (out.b - out.a).normalized();
  out.normal = {-along.y(), along.x()};
  return out;
}

HomogeneousPoint AnchoredLine::end(const Vec2& m, double offset, double inverse_depth) const {
  const Vec2 moved = m + offset * anchor.normal;
  return {anchor.T_w_c.q * Vec3(moved.x(), moved.y(), 1) + inverse_depth * anchor.T_w_c.p, inverse_depth};
}

bool AnchoredLine::finite() const { return coordinates[1] > 1e-3 && coordinates[3] > 1e-3; }

LineEnds AnchoredLine::ends() const {
  const HomogeneousPoint a = end_a(), b = end_b();
  return {a.x / a.w, b.x / b.w};
}

// As for points (residuals.cpp), times w: u = R^T (x - w (p + v dt + g dt^2 / 2)), x_i = dR^T (u - w dp),
// x_c = R_c_i x_i + w p_c_i.
HomogeneousInCamera to_camera(const HomogeneousPoint& point, const NavState& state,
                              const Preintegrated& motion, const ImuBias& linearised_at,
                              const Projection& projection) {
  const double dt = motion.dt, w = point.w;
  const Vec3 dbg = state.bias.gyro - linearised_at.gyro;
  const Vec3 dba = state.bias.accel - linearised_at.accel;
  const Vec3 correction = motion.d_R_d_bg * dbg;
  const Mat3 R = state.T_w_i.q.toRotationMatrix();
  const Mat3 dR = motion.dR * so3_exp(correction);
  const Vec3 dp = motion.dp + motion.d_p_d_bg * dbg + motion.d_p_d_ba * dba;
  const Vec3 origin = state.T_w_i.p + state.v_w * dt + 0.5 * dt * dt * projection.gravity;
  const Vec3 u = R.transpose() * (point.x - w * origin);
  const Vec3 x_i = dR.transpose() * (u - w * dp);
  const Mat3 R_c_i = projection.T_i_c.q.conjugate().toRotationMatrix();
  const Mat3 R_c_0 = R_c_i * dR.transpose();
  const Mat3 R_c_w = R_c_0 * R.transpose();

  HomogeneousInCamera out;
  out.x = R_c_i * (x_i - w * projection.T_i_c.p);
  out.d_x_d_point = R_c_w;
  out.d_x_d_w = -R_c_w * origin - R_c_0 * dp - R_c_i * projection.T_i_c.p;
  out.d_x_d_state.block<3, 3>(0, 0) = -w * R_c_w;
  out.d_x_d_state.block<3, 3>(0, 3) = R_c_0 * hat(u);
  out.d_x_d_state.block<3, 3>(0, 6) = -w * dt * R_c_w;
  out.d_x_d_state.block<3, 3>(0, 9) =
      R_c_i * hat(x_i) * right_jacobian(correction) * motion.d_R_d_bg - w * R_c_0 * motion.d_p_d_bg;
  out.d_x_d_state.block<3, 3>(0, 12) = -w * R_c_0 * motion.d_p_d_ba;
  return out;
}

BinResidual bin_to_line(const Vec2& a_px, const Vec2& b_px, const AnchoredLine& line, const NavState& state,
                        const Preintegrated& motion, const ImuBias& linearised_at,
                        const Projection& projection) {
  BinResidual r;
  const auto a = to_camera(line.end_a(), state, motion, linearised_at, projection);
  const auto b = to_camera(line.end_b(), state, motion, linearised_at, projection);
  const Camera& camera = projection.camera;
  const Vec3 n = a.x.cross(b.x);  // of the plane through the line and the camera's centre
  const double h = std::hypot(n.x() / camera.fx, n.y() / camera.fy);
  if (!(h > 1e-9)) return r;
  const Vec3 d_h(n.x() / (camera.fx * camera.fx * h), n.y() / (camera.fy * camera.fy * h), 0);
  const Mat3 R_w_c = line.anchor.T_w_c.R();
  const Vec3 across = R_w_c.col(0) * line.anchor.normal.x() + R_w_c.col(1) * line.anchor.normal.y();
  for (int k = 0; k < 2; ++k) {
    const Vec2 m = camera.normalise(k == 0 ? a_px : b_px);
    const Vec3 ray(m.x(), m.y(), 1);
    r.value[k] = n.dot(ray) / h;
    const RowVec3 d_n = (ray - r.value[k] * d_h).transpose() / h;
    const RowVec3 d_a = -d_n * hat(b.x), d_b = d_n * hat(a.x);
    r.d_state.row(k) = d_a * a.d_x_d_state + d_b * b.d_x_d_state;
    // d point / d inverse depth = the anchor's position, d w / d inverse depth = 1.
    const RowVec3 to_a = d_a * a.d_x_d_point, to_b = d_b * b.d_x_d_point;
    r.d_line.row(k) << to_a.dot(across), to_a.dot(line.anchor.T_w_c.p) + d_a.dot(a.d_x_d_w), to_b.dot(across),
        to_b.dot(line.anchor.T_w_c.p) + d_b.dot(b.d_x_d_w);
  }
  r.valid = true;
  return r;
}

}  // namespace idol
