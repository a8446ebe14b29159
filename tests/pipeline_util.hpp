// The whole method run in memory on simulated recordings.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>
#include <string_view>
#include <vector>

#include "idol/odometry/odometry.hpp"
#include "idol/odometry/presets.hpp"
#include "idol/sim/simulator.hpp"

namespace idol::test {

inline Rig davis_rig() {
  Rig rig;
  rig.camera = {240, 180, 199.1, 198.8, 132.2, 110.7, Distortion::kRadTan, {-0.37, 0.15, 0, 0, 0}};
  rig.T_i_c = {quat_exp(Vec3(0.01, -0.006, 0.012)), Vec3(0.007, 0.001, 0.034)};
  rig.imu.rate_hz = 500;
  return rig;
}

inline Scene shapes() { return load_scene(std::filesystem::path(IDOL_DATA_DIR) / "scenes/shapes.yaml"); }

inline SimulatedRecording record(const Rig& rig, const HandMotion& motion) {
  const Scene scene = shapes();
  return simulate_in_memory(scene, hand_motion(starting_camera(scene) * rig.T_i_c.inverse(), motion), rig,
                            {});
}

inline SimulatedRecording record(const Rig& rig, double duration_s) {
  HandMotion motion;
  motion.duration_s = duration_s;
  motion.still_s = 0.6;
  motion.seed = 3;
  return record(rig, motion);
}

// Both streams to the odometry in packets of `chunk` events, the IMU up to the packet's end first.
inline void feed(Odometry& odometry, const SimulatedRecording& data, std::size_t chunk) {
  std::size_t imu = 0;
  for (std::size_t i = 0; i < data.events.size(); i += chunk) {
    const std::span events(data.events.data() + i, std::min(chunk, data.events.size() - i));
    for (; imu < data.imu.size() && data.imu[imu].t <= events.back().t; ++imu) odometry.push(data.imu[imu]);
    odometry.push(events);
  }
  for (; imu < data.imu.size(); ++imu) odometry.push(data.imu[imu]);
  odometry.finish();
}

inline std::vector<NavState> estimate(const Rig& rig, const SimulatedRecording& data, std::size_t chunk,
                                      std::string_view name, std::vector<NavState>* causal = nullptr,
                                      int threads = 2) {
  Options options = preset(name);
  options.pipeline.threads = threads;
  Odometry odometry(rig, options);
  odometry.on_estimate([&](const Estimate& e) {
    if (causal != nullptr) causal->push_back(e.state);
  });
  feed(odometry, data, chunk);
  return odometry.smoother().states();
}

// Root mean square of position after the first poses are laid over each other, and of rotation.
struct Errors {
  double position_m, rotation_deg;
};
inline Errors judge(const std::vector<NavState>& states, const std::vector<NavState>& truth) {
  const auto at = [&](Time t) {
    const auto k = static_cast<std::size_t>(
        std::clamp<Time>((t - truth.front().t) * 200 / kNsPerS, 0, std::ssize(truth) - 2));
    return interpolate(truth[k].T_w_i, truth[k + 1].T_w_i, seconds_between(truth[k].t, t) / 0.005);
  };
  const Pose first = at(states.front().t);
  const Vec3 turn = quat_log(first.q * states.front().T_w_i.q.conjugate());
  const Quat yaw = quat_exp(Vec3(0, 0, turn.z()));
  Errors sum{0, 0};
  for (const auto& s : states) {
    const Pose t = at(s.t);
    sum.position_m += (yaw * (s.T_w_i.p - states.front().T_w_i.p) - (t.p - first.p)).squaredNorm();
    sum.rotation_deg += std::pow(quat_log(t.q.conjugate() * yaw * s.T_w_i.q).norm() * 180 / M_PI, 2);
  }
  const auto n = static_cast<double>(states.size());
  return {std::sqrt(sum.position_m / n), std::sqrt(sum.rotation_deg / n)};
}

}  // namespace idol::test
