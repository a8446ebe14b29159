#include "idol/backend/backend.hpp"

#include <algorithm>

namespace idol {

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
  NavState state = predict(states_[i], windows_[i].imu->at(t), windows_[i].imu->bias(), projection_.gravity);
  state.t = t;
  return state;
}

}  // namespace idol
