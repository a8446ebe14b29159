// The motion of the preintegration study: Euler angles and position are sums of three sines an axis, as in
// the simulation of Le Gentil & Vidal-Calleja (RSS 2021), with exact IMU readings.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <numbers>
#include <random>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol::bench {

struct Sine {
  double amplitude, omega, phase;
  [[nodiscard]] double value(double t) const { return amplitude * std::sin(omega * t + phase); }
  [[nodiscard]] double rate(double t) const { return amplitude * omega * std::cos(omega * t + phase); }
  [[nodiscard]] double acceleration(double t) const { return -omega * omega * value(t); }
};

/// Ranges of the sines: amplitudes of the angles [rad] and of the velocity [m/s], frequencies [Hz].
struct MotionKind {
  const char* name;
  double angle_min, angle_max, angle_hz_min, angle_hz_max;
  double velocity_min, velocity_max, velocity_hz_min, velocity_hz_max;
};
/// Mean rate about 6 rad/s with peaks above 12, accelerations of 60 m/s^2.
inline constexpr MotionKind kFast = {"fast", 0.2, 0.45, 0.5, 2.3, 2, 3, 0.5, 3.0};
/// Mean rate 0.6 rad/s.
inline constexpr MotionKind kSlow = {"slow", 0.2, 0.35, 0.05, 0.35, 0.3, 2, 0.05, 0.2};

class SineMotion {
 public:
  SineMotion(const MotionKind& kind, unsigned seed) {
    std::mt19937 rng(seed);
    const auto uniform = [&](double a, double b) { return a + (b - a) * (rng() / 4294967296.0); };
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t i = 0; i < 3; ++i) {
        const auto third = [&](double lo, double hi) {  // of the range, one for each sine
          const double step = (hi - lo) / 3;
          return 2 * std::numbers::pi *
                 uniform(lo + step * static_cast<double>(i), lo + step * static_cast<double>(i + 1));
        };
        const double phase = uniform(0, 2 * std::numbers::pi);
        angle_[axis][i] = {uniform(kind.angle_min, kind.angle_max),
                           third(kind.angle_hz_min, kind.angle_hz_max), phase};
        const double omega = third(kind.velocity_hz_min, kind.velocity_hz_max);
        position_[axis][i] = {uniform(kind.velocity_min, kind.velocity_max) / omega, omega,
                              uniform(0, 2 * std::numbers::pi)};
      }
  }

  [[nodiscard]] Mat3 R(double t) const {
    const Vec3 e = sum(angle_, &Sine::value, t);
    return (Eigen::AngleAxisd(e.z(), Vec3::UnitZ()) * Eigen::AngleAxisd(e.y(), Vec3::UnitY()) *
            Eigen::AngleAxisd(e.x(), Vec3::UnitX()))
        .toRotationMatrix();
  }
  [[nodiscard]] Vec3 rate(double t) const {
    const Vec3 e = sum(angle_, &Sine::value, t), d = sum(angle_, &Sine::rate, t);
    const double sx = std::sin(e.x()), cx = std::cos(e.x()), sy = std::sin(e.y()), cy = std::cos(e.y());
    return {d.x() - d.z() * sy, d.y() * cx + d.z() * cy * sx, -d.y() * sx + d.z() * cy * cx};
  }
  [[nodiscard]] Vec3 position(double t) const { return sum(position_, &Sine::value, t); }
  [[nodiscard]] Vec3 velocity(double t) const { return sum(position_, &Sine::rate, t); }
  [[nodiscard]] Vec3 force(double t) const {
    return R(t).transpose() * (sum(position_, &Sine::acceleration, t) - kGravity);
  }
  [[nodiscard]] ImuSample reading(double t) const { return {from_seconds(t), force(t), rate(t)}; }

  /// What an ideal preintegration from t0 to t1 gives.
  [[nodiscard]] Motion truth(double t0, double t1) const {
    Motion out;
    out.dt = t1 - t0;
    const Mat3 Rt = R(t0).transpose();
    out.dR = Rt * R(t1);
    out.dv = Rt * (velocity(t1) - velocity(t0) - kGravity * out.dt);
    out.dp = Rt * (position(t1) - position(t0) - velocity(t0) * out.dt - 0.5 * out.dt * out.dt * kGravity);
    return out;
  }

 private:
  using Sines = std::array<std::array<Sine, 3>, 3>;
  static Vec3 sum(const Sines& sines, double (Sine::*part)(double) const, double t) {
    Vec3 out = Vec3::Zero();
    for (int axis = 0; axis < 3; ++axis)
      for (const Sine& sine : sines[static_cast<std::size_t>(axis)]) out[axis] += (sine.*part)(t);
    return out;
  }
  static inline const Vec3 kGravity = Vec3(0, 0, -9.81);
  Sines angle_, position_;
};

/// Readings of [t0, t1] at a rate, with white noise of the given size a sample.
inline std::vector<ImuSample> readings(const SineMotion& motion, double t0, double t1, double rate_hz,
                                       double gyro_sigma, double accel_sigma, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal;
  const auto random = [&] { return Vec3(normal(rng), normal(rng), normal(rng)); };
  std::vector<ImuSample> out;
  const auto count = static_cast<int>(std::lround((t1 - t0) * rate_hz));
  for (int k = 0; k <= count; ++k) {
    ImuSample s = motion.reading(t0 + k / rate_hz);
    s.gyro += gyro_sigma * random();
    s.accel += accel_sigma * random();
    out.push_back(s);
  }
  return out;
}

}  // namespace idol::bench
