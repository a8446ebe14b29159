// The algebra of preintegrated motions.
#include "idol/imu/preintegration.hpp"

namespace idol {

Motion operator*(const Motion& first, const Motion& second) {
  Motion out;
  out.dt = first.dt + second.dt;
  out.dR = first.dR * second.dR;
  out.dv = first.dv + first.dR * second.dv;
  out.dp = first.dp + first.dv * second.dt + first.dR * second.dp;
  return out;
}

// Derivatives of the above; dR1 Exp(J b) x = dR1 (x - hat(x) J b) to first order.
Preintegrated operator*(const Preintegrated& first, const Preintegrated& second) {
  Preintegrated out;
  static_cast<Motion&>(out) = static_cast<const Motion&>(first) * static_cast<const Motion&>(second);
  const Mat3 R_2t = second.dR.transpose();
  const Mat3 V = first.dR * hat(second.dv), P = first.dR * hat(second.dp);
  out.d_R_d_bg = R_2t * first.d_R_d_bg + second.d_R_d_bg;
  out.d_v_d_bg = first.d_v_d_bg + first.dR * second.d_v_d_bg - V * first.d_R_d_bg;
  out.d_v_d_ba = first.d_v_d_ba + first.dR * second.d_v_d_ba;
  out.d_p_d_bg =
      first.d_p_d_bg + second.dt * first.d_v_d_bg + first.dR * second.d_p_d_bg - P * first.d_R_d_bg;
  out.d_p_d_ba = first.d_p_d_ba + second.dt * first.d_v_d_ba + first.dR * second.d_p_d_ba;
  out.d_R_d_shift = R_2t * first.d_R_d_shift + second.d_R_d_shift;
  out.d_v_d_shift = first.d_v_d_shift + first.dR * second.d_v_d_shift - V * first.d_R_d_shift;
  out.d_p_d_shift = first.d_p_d_shift + second.dt * first.d_v_d_shift + first.dR * second.d_p_d_shift -
                    P * first.d_R_d_shift;
  out.rate = second.rate;
  out.accel = first.dR * second.accel;
  return out;
}

Motion inverse(const Motion& motion) {
  Motion out;
  out.dt = -motion.dt;
  out.dR = motion.dR.transpose();
  out.dv = -(out.dR * motion.dv);
  out.dp = out.dR * (motion.dv * motion.dt - motion.dp);
  return out;
}

// With Exp(-theta) R^T x = R^T x + hat(R^T x) theta: derivatives of the above by errors of (dp, dtheta, dv).
Mat9 inverse_covariance(const Motion& motion, const Mat9& covariance) {
  const Motion back = inverse(motion);
  Mat9 J = Mat9::Zero();
  J.block<3, 3>(0, 0) = -back.dR;
  J.block<3, 3>(0, 3) = hat(back.dp);
  J.block<3, 3>(0, 6) = motion.dt * back.dR;
  J.block<3, 3>(3, 3) = -motion.dR;
  J.block<3, 3>(6, 3) = hat(back.dv);
  J.block<3, 3>(6, 6) = -back.dR;
  return J * covariance * J.transpose();
}

Preintegrated later(const Preintegrated& motion, double dt) {
  Preintegrated out = motion;
  out.dt += dt;
  out.dR = motion.dR * so3_exp(dt * motion.rate);
  out.dv += dt * motion.accel;
  out.dp += dt * motion.dv + 0.5 * dt * dt * motion.accel;
  out.d_R_d_bg = so3_exp(-dt * motion.rate) * motion.d_R_d_bg - dt * Mat3::Identity();
  out.d_v_d_bg -= dt * hat(motion.accel) * motion.dR * motion.d_R_d_bg;
  out.d_v_d_ba -= dt * motion.dR;
  out.d_p_d_bg += dt * motion.d_v_d_bg;
  out.d_p_d_ba += dt * motion.d_v_d_ba;
  return out;
}

NavState predict(const NavState& begin, const Preintegrated& motion, const ImuBias& bias,
                 const Vec3& gravity) {
  const Vec3 dbg = begin.bias.gyro - bias.gyro;
  const Vec3 dba = begin.bias.accel - bias.accel;
  const double dt = motion.dt;
  NavState out;
  out.t = begin.t + from_seconds(dt);
  out.bias = begin.bias;
  out.time_shift = begin.time_shift;
  out.event_lag_px = begin.event_lag_px;
  out.T_w_i.q = (begin.T_w_i.q * Quat(motion.dR) * quat_exp(motion.d_R_d_bg * dbg)).normalized();
  out.v_w =
      begin.v_w + gravity * dt + begin.T_w_i.q * (motion.dv + motion.d_v_d_bg * dbg + motion.d_v_d_ba * dba);
  out.T_w_i.p = begin.T_w_i.p + begin.v_w * dt + 0.5 * dt * dt * gravity +
                begin.T_w_i.q * (motion.dp + motion.d_p_d_bg * dbg + motion.d_p_d_ba * dba);
  return out;
}

}  // namespace idol
