#include "idol/sim/spline.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

// Cumulative cubic basis B_1..B_3 at u in [0, 1], with derivatives by u.
struct Basis {
  double value[3], first[3], second[3];
};
Basis cumulative_basis(double u) {
  const double u2 = u * u, u3 = u2 * u;
  return {{(5 + 3 * u - 3 * u2 + u3) / 6, (1 + 3 * u + 3 * u2 - 2 * u3) / 6, u3 / 6},
          {(3 - 6 * u + 3 * u2) / 6, (3 + 6 * u - 6 * u2) / 6, u2 / 2},
          {(-6 + 6 * u) / 6, (6 - 12 * u) / 6, u}};
}

double smoothstep(double x) {
  x = std::clamp(x, 0.0, 1.0);
  return x * x * x * (10 + x * (-15 + 6 * x));
}

// Sum of sines with given frequencies [Hz] and random phases, amplitude about one.
class Wander {
 public:
  Wander(std::initializer_list<double> hz, std::mt19937_64& rng) {
    for (double f : hz)
      waves_.push_back({f, std::uniform_real_distribution<double>(0, 2 * std::numbers::pi)(rng)});
  }
  [[nodiscard]] double at(double t) const {
    double sum = 0;
    for (const auto& [hz, phase] : waves_)
      sum += (std::sin(2 * std::numbers::pi * hz * t + phase) - std::sin(phase)) /
             static_cast<double>(waves_.size());
    return sum;
  }

 private:
  std::vector<std::pair<double, double>> waves_;
};

}  // namespace

Spline::Spline(std::vector<Pose> control, double spacing_s)
    : control_(std::move(control)), spacing_(spacing_s) {
  if (control_.size() < 4) throw DataError("a spline needs at least four control poses");
  for (std::size_t k = 0; k + 1 < control_.size(); ++k)
    turn_.push_back(quat_log(control_[k].q.conjugate() * control_[k + 1].q));
}

Kinematics Spline::at(double t) const {
  const double s = std::clamp(t / spacing_, 0.0, static_cast<double>(control_.size() - 3));
  const auto first = std::min(static_cast<std::size_t>(s), control_.size() - 4);
  const Basis b = cumulative_basis(s - static_cast<double>(first));
  Kinematics out;
  out.T_w_i = control_[first];
  for (std::size_t j = 0; j < 3; ++j) {
    const Vec3 step = control_[first + j + 1].p - control_[first + j].p;
    out.T_w_i.p += b.value[j] * step;
    out.velocity_w += b.first[j] / spacing_ * step;
    out.acceleration_w += b.second[j] / (spacing_ * spacing_) * step;
    const Vec3& turn = turn_[first + j];
    const Quat q = quat_exp(b.value[j] * turn);
    out.rate_i = q.conjugate() * out.rate_i + b.first[j] / spacing_ * turn;
    out.T_w_i.q = (out.T_w_i.q * q).normalized();
  }
  return out;
}

Spline hand_motion(const Pose& start, const HandMotion& motion) {
  std::mt19937_64 rng(motion.seed);
  std::vector<Wander> wander, tremor;
  for (int axis = 0; axis < 6; ++axis) {
    const double f = 1.0 + 0.1 * axis;
    wander.emplace_back(std::initializer_list<double>{0.19 * f, 0.37 * f, 0.71 * f}, rng);
    tremor.emplace_back(std::initializer_list<double>{7.3 * f, 9.1 * f}, rng);
  }
  constexpr double kSpacing = 0.02;
  std::vector<Pose> control;
  for (int k = 0; k < static_cast<int>(std::ceil(motion.duration_s / kSpacing)) + 3; ++k) {
    const double t = (k - 1) * kSpacing;
    const double grown = smoothstep((t - motion.still_s) / 2.0);
    const double wander_t = motion.speed * std::max(0.0, t - motion.still_s);
    Vec3 shift, turn;
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      shift[axis] = motion.position_m * grown * wander[a].at(wander_t) + 1e-4 * tremor[a].at(t);
      turn[axis] =
          (motion.translation_only ? 0.1 : 1.0) * motion.rotation_rad * grown * wander[a + 3].at(wander_t) +
          2e-4 * tremor[a + 3].at(t);
    }
    control.push_back({start.q * quat_exp(turn), start.p + shift});
  }
  return Spline(std::move(control), kSpacing);
}

Spline spline_from_trajectory(const Trajectory& camera, const Pose& T_i_c, double speed) {
  if (camera.size() < 2 || seconds_between(camera.front().t, camera.back().t) < 1)
    throw DataError("the trajectory to follow is shorter than a second");
  constexpr double kSpacing = 0.04;
  const Pose T_c_i = T_i_c.inverse();
  std::vector<Pose> control;
  std::size_t k = 0;
  for (double t = 0;; t += kSpacing) {
    const Time stamp = camera.front().t + from_seconds(t * speed);
    if (stamp > camera.back().t) break;
    while (k + 2 < camera.size() && camera[k + 1].t < stamp) ++k;
    const double share = seconds_between(camera[k].t, stamp) / seconds_between(camera[k].t, camera[k + 1].t);
    control.push_back(interpolate(camera[k].T, camera[k + 1].T, std::clamp(share, 0.0, 1.0)) * T_c_i);
  }
  return Spline(std::move(control), kSpacing);
}

}  // namespace idol
