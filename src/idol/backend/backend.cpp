#include "idol/backend/backend.hpp"

#include <algorithm>

namespace idol {
namespace {

// Cubic Hermite curve in position, the shortest way in rotation.
NavState between(const NavState& a, const NavState& b, Time t) {
  const double dt = seconds_between(a.t, b.t), u = dt > 0 ? seconds_between(a.t, t) / dt : 0;
  NavState out = a;
  out.T_w_i.q = a.T_w_i.q.slerp(u, b.T_w_i.q);
  const Vec3 chord = b.T_w_i.p - a.T_w_i.p, va = a.v_w * dt, vb = b.v_w * dt;
  const Vec3 c2 = 3 * chord - 2 * va - vb, c3 = va + vb - 2 * chord;
  out.T_w_i.p = a.T_w_i.p + u * (va + u * (c2 + u * c3));
  out.v_w = (va + u * (2 * c2 + 3 * u * c3)) / std::max(dt, 1e-9);
  return out;
}

}  // namespace

void Backend::append(const WindowMeasurement& window) {
  const Preintegration& imu = *window.imu;
  states_.push_back(predict(states_.back(), imu.at(imu.end()), imu.bias(), projection_.gravity));
  states_.back().t = imu.end();
  windows_.push_back({window.imu, window.still});
}

NavState Backend::state_at(Time t) const {
  const auto after = std::upper_bound(states_.begin(), states_.end(), t,
                                      [](Time value, const NavState& state) { return value < state.t; });
  const auto index = std::clamp<std::ptrdiff_t>(after - states_.begin() - 1, 0, std::ssize(windows_) - 1);
  const auto i = static_cast<std::size_t>(index);
  const Preintegration* imu = windows_[i].imu.get();
  NavState state;
  if (imu == nullptr) {
    state = between(states_[i], states_[i + 1], t);
  } else {
    const Time inside = std::min(t, imu->end());
    state = predict(states_[i], later(imu->at(inside), seconds_between(inside, t)), imu->bias(),
                    projection_.gravity);
  }
  state.t = t;
  return state;
}

StampedPose Backend::camera_pose(const NavState& state) const {
  const NavState then = state_at(state.t + from_seconds(state.time_shift));
  return {state.t - from_seconds(time_offset_s_), then.T_w_i * projection_.T_i_c};
}

}  // namespace idol
