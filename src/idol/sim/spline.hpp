// A smooth motion with exact derivatives: uniform cumulative cubic B-spline on SO(3) x R^3 (Sommer et al.
// 2020).
#pragma once

#include <cstdint>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// Pose of the IMU with everything an ideal IMU feels.
struct Kinematics {
  Pose T_w_i;
  Vec3 velocity_w = Vec3::Zero();      ///< [m/s]
  Vec3 acceleration_w = Vec3::Zero();  ///< [m/s^2]
  Vec3 rate_i = Vec3::Zero();          ///< angular rate in the IMU frame [rad/s]
};

/// Position is C2, orientation C2. Times are seconds from 0 to duration().
class Spline {
 public:
  /// Control poses every `spacing_s`; at least four. Neighbours less than pi apart.
  Spline(std::vector<Pose> control, double spacing_s);

  [[nodiscard]] double duration() const { return spacing_ * static_cast<double>(control_.size() - 3); }
  [[nodiscard]] Kinematics at(double t) const;

 private:
  std::vector<Pose> control_;
  std::vector<Vec3> turn_;  // Log(q_k^-1 q_k+1)
  double spacing_;
};

struct HandMotion {
  double duration_s = 8;
  double still_s = 1.0;      ///< near rest at the start, then the motion grows over two seconds
  double speed = 1.0;        ///< scales all frequencies
  double position_m = 0.35;  ///< amplitude of the wandering
  double rotation_rad = 0.25;
  bool translation_only = false;
  std::uint64_t seed = 1;
};

/// A hand-held wander about `start` (pose of the IMU): sums of sines with random phases, and a small tremor.
Spline hand_motion(const Pose& start, const HandMotion& motion);

/// A spline near the poses of a recorded trajectory of the camera, e.g. of motion capture; gaps are bridged.
/// `speed` plays it faster or slower. Throws DataError if it is shorter than a second.
Spline spline_from_trajectory(const Trajectory& camera, const Pose& T_i_c, double speed);

}  // namespace idol
