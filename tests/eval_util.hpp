// Trajectories made by hand for the tests of the evaluation.
#pragma once

#include <fmt/format.h>

#include <numbers>
#include <random>
#include <string>

#include "idol/base/types.hpp"
#include "test_util.hpp"

namespace idol::test {

constexpr double kRad = std::numbers::pi / 180.0;

/// Rotation about z [deg].
inline Quat yaw_deg(double degrees) { return quat_exp({0, 0, degrees * kRad}); }

/// A pose at `t_s` [s].
inline StampedPose pose_at(double t_s, const Vec3& p, const Quat& q = Quat::Identity()) {
  return {from_seconds(t_s), {q, p}};
}

/// Bare poses at these seconds, for tests of the association.
inline Trajectory at_seconds(const std::vector<double>& seconds) {
  Trajectory trajectory;
  for (const double t : seconds) trajectory.push_back(pose_at(t, Vec3::Zero()));
  return trajectory;
}

/// A wavy walk with turning, nowhere degenerate: `n` poses, `dt` apart.
inline Trajectory wavy_walk(std::size_t n, double dt = 0.05) {
  Trajectory trajectory;
  for (std::size_t i = 0; i < n; ++i) {
    const double t = dt * static_cast<double>(i);
    trajectory.push_back(pose_at(t, {t, std::sin(2 * t), 0.3 * std::cos(3 * t)},
                                 quat_exp({0.2 * std::sin(t), 0.1 * std::cos(2 * t), 0.5 * t})));
  }
  return trajectory;
}

/// Every pose moved by `T` from the left, positions scaled first: what an alignment has to undo.
inline Trajectory moved(const Trajectory& trajectory, const Pose& T, double scale = 1.0) {
  Trajectory result = trajectory;
  for (StampedPose& pose : result) pose.T = {(T.q * pose.T.q).normalized(), T.q * (scale * pose.T.p) + T.p};
  return result;
}

/// As a file of rows t tx ty tz qx qy qz qw, with all digits.
inline std::string as_text(const Trajectory& trajectory) {
  std::string text = "# t tx ty tz qx qy qz qw\n";
  for (const auto& [t, T] : trajectory)
    text +=
        fmt::format("{}.{:09} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\n", t / 1'000'000'000,
                    t % 1'000'000'000, T.p.x(), T.p.y(), T.p.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w());
  return text;
}

}  // namespace idol::test
