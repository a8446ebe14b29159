#include "idol/backend/backend.hpp"

#include <algorithm>

namespace idol {

NavState state_between(const NavState& a, const Vec3& rate_a, const NavState& b, const Vec3& rate_b, Time t) {
  const double dt = seconds_between(a.t, b.t), u = dt > 0 ? seconds_between(a.t, t) / dt : 0;
  const auto cubic = [u](const Vec3& end, const Vec3& slope0, const Vec3& slope1) -> Vec3 {
    return u * (slope0 + u * (3 * end - 2 * slope0 - slope1 + u * (slope0 + slope1 - 2 * end)));
  };
  const Vec3 chord = b.T_w_i.p - a.T_w_i.p, va = a.v_w * dt, vb = b.v_w * dt;
  const Vec3 turn = quat_log(a.T_w_i.q.conjugate() * b.T_w_i.q);
  NavState out = a;
  out.t = t;
  out.T_w_i.p += cubic(chord, va, vb);
  out.T_w_i.q = (a.T_w_i.q * quat_exp(cubic(turn, rate_a * dt, right_jacobian_inverse(turn) * rate_b * dt)))
                    .normalized();
  out.v_w = (va + u * (2 * (3 * chord - 2 * va - vb) + 3 * u * (va + vb - 2 * chord))) / std::max(dt, 1e-9);
  return out;
}

void Backend::append(const WindowMeasurement& window) {
  const Preintegration& imu = *window.imu;
  states_.push_back(predict(states_.back(), imu.at(imu.end()), imu.bias(), projection_.gravity));
  states_.back().t = imu.end();
  windows_.push_back(
      {window.imu, imu.bias(), imu.angular_rate(imu.begin()), imu.angular_rate(imu.end()), window.still});
}

NavState Backend::state_at(Time t) const {
  const auto after = std::upper_bound(states_.begin(), states_.end(), t,
                                      [](Time value, const NavState& state) { return value < state.t; });
  const auto index = std::clamp<std::ptrdiff_t>(after - states_.begin() - 1, 0, std::ssize(windows_) - 1);
  const auto i = static_cast<std::size_t>(index);
  const Window& window = windows_[i];
  const Preintegration* imu = window.imu.get();
  if (imu == nullptr) {
    const NavState &from = states_[i], &to = states_[i + 1];
    return state_between(from, window.rate_begin + window.bias.gyro - from.bias.gyro, to,
                         window.rate_end + window.bias.gyro - to.bias.gyro, t);
  }
  const Time inside = std::min(t, imu->end());
  NavState state = predict(states_[i], later(imu->at(inside), seconds_between(inside, t)), window.bias,
                           projection_.gravity);
  state.t = t;
  return state;
}

StampedPose Backend::camera_pose(const NavState& state) const {
  const NavState then = state_at(state.t + from_seconds(state.time_shift));
  return {state.t - from_seconds(time_offset_s_), then.T_w_i * projection_.T_i_c};
}

}  // namespace idol
