// An analytic motion with its exact IMU readings, for tests of the inertial side.
#pragma once

#include <random>
#include <vector>

#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"

namespace idol::test {

/// Rotation vector and position are sums of sines per axis; `speed` scales all frequencies.
struct SineMotion {
  double speed = 1.0;
  Vec3 gravity = Vec3(0, 0, -9.81);

  [[nodiscard]] Vec3 theta(double t) const {
    const double s = speed * t;
    return {0.6 * std::sin(1.3 * s), 0.5 * std::sin(1.7 * s + 0.4), 0.7 * std::sin(1.1 * s + 1.0)};
  }
  [[nodiscard]] Vec3 theta_rate(double t) const {
    const double s = speed * t;
    return speed * Vec3(0.78 * std::cos(1.3 * s), 0.85 * std::cos(1.7 * s + 0.4), 0.77 * std::cos(1.1 * s + 1.0));
  }
  [[nodiscard]] Vec3 position(double t) const {
    const double s = speed * t;
    return {0.3 * std::sin(2.0 * s), 0.2 * std::cos(1.5 * s), 0.25 * std::sin(1.2 * s + 0.7)};
  }
  [[nodiscard]] Vec3 velocity(double t) const {
    const double s = speed * t;
    return speed * Vec3(0.6 * std::cos(2.0 * s), -0.3 * std::sin(1.5 * s), 0.3 * std::cos(1.2 * s + 0.7));
  }
  [[nodiscard]] Vec3 acceleration(double t) const {
    const double s = speed * t;
    return speed * speed * Vec3(-1.2 * std::sin(2.0 * s), -0.45 * std::cos(1.5 * s), -0.36 * std::sin(1.2 * s + 0.7));
  }
  [[nodiscard]] NavState state(double t) const {
    NavState out;
    out.t = from_seconds(t);
    out.T_w_i = {quat_exp(theta(t)), position(t)};
    out.v_w = velocity(t);
    return out;
  }
  [[nodiscard]] ImuSample reading(double t) const {
    const Vec3 angle = theta(t);
    ImuSample s;
    s.t = from_seconds(t);
    s.gyro = right_jacobian(angle) * theta_rate(t);
    s.accel = quat_exp(angle).conjugate() * (acceleration(t) - gravity);
    return s;
  }
  /// Readings of [t0, t1] at a rate, with biases and white noise of the given densities.
  [[nodiscard]] std::vector<ImuSample> readings(double t0, double t1, double rate_hz, const ImuBias& bias = {},
                                                const ImuNoise* noise = nullptr, unsigned seed = 0) const {
    std::mt19937 rng(seed);
    std::normal_distribution<double> normal;
    const auto random = [&] { return Vec3(normal(rng), normal(rng), normal(rng)); };
    std::vector<ImuSample> out;
    const auto count = static_cast<int>(std::lround((t1 - t0) * rate_hz));
    for (int k = 0; k <= count; ++k) {
      ImuSample s = reading(t0 + k / rate_hz);
      s.gyro += bias.gyro;
      s.accel += bias.accel;
      if (noise != nullptr) {
        s.gyro += noise->gyro_density * std::sqrt(rate_hz) * random();
        s.accel += noise->accel_density * std::sqrt(rate_hz) * random();
      }
      out.push_back(s);
    }
    return out;
  }
};

}  // namespace idol::test
