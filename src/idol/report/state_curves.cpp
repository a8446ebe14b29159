#include "idol/report/state_curves.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

namespace idol {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
/// Half the span that ground truth is differentiated over: long enough for motion capture's noise [s].
constexpr double kVelocityHalfSpan = 0.025;
constexpr double kBandSigmas = 3;

using AxisNames = std::array<const char*, 3>;
constexpr AxisNames kXyz = {"x", "y", "z"};
constexpr AxisNames kRollPitchYaw = {"roll", "pitch", "yaw"};
using Vectors = std::vector<Vec3>;
using Seconds = std::vector<double>;

template <class Stamped>
Seconds seconds_of(const std::vector<Stamped>& all, Time zero) {
  Seconds t;
  for (const Stamped& one : all) t.push_back(seconds_between(zero, one.t));
  return t;
}

Vectors vectors_of(const std::vector<NavState>& states, const std::function<Vec3(const NavState&)>& part) {
  Vectors out;
  for (const NavState& s : states) out.push_back(part(s));
  return out;
}

/// Three series out of one vector a sample; `sigma` may be empty.
void add_vectors(Panel& panel, const AxisNames& names, const std::string& style, const Seconds& t,
                 const Vectors& values, const Vectors& sigma = {}) {
  if (t.empty()) return;
  for (int axis = 0; axis < 3; ++axis) {
    Series s{names[static_cast<std::size_t>(axis)], axis, style, t, {}, {}};
    for (const Vec3& v : values) s.y.push_back(v[axis]);
    for (const Vec3& v : sigma) s.band.push_back(kBandSigmas * v[axis]);
    panel.series.push_back(std::move(s));
  }
}

/// Standard deviations of three columns of windows.csv at the stamps of states, NaN where there is none;
/// empty if the estimator has none at all.
Vectors sigmas_at(const CsvColumns& windows, const std::vector<NavState>& states, const AxisNames& columns) {
  std::array<const std::vector<double>*, 3> found{};
  for (std::size_t k = 0; k < 3; ++k) found[k] = windows.find(columns[k]);
  if (std::count(found.begin(), found.end(), nullptr) > 0) return {};
  Vectors out;
  bool any = false;
  for (const NavState& s : states) {
    const auto i = static_cast<std::size_t>(std::lower_bound(windows.t.begin(), windows.t.end(), s.t) -
                                            windows.t.begin());
    Vec3 sigma = Vec3::Constant(kNan);
    if (i < windows.t.size())
      for (std::size_t k = 0; k < 3; ++k) sigma[static_cast<Eigen::Index>(k)] = (*found[k])[i];
    any = any || (sigma.array() > 0).any();
    out.push_back(sigma);
  }
  return any ? out : Vectors();
}

/// z-y-x Euler angles [rad].
Vec3 euler_angles(const Quat& q) {
  const Mat3 R = q.toRotationMatrix();
  return {std::atan2(R(2, 1), R(2, 2)), -std::asin(std::clamp(R(2, 0), -1.0, 1.0)),
          std::atan2(R(1, 0), R(0, 0))};
}

/// Without jumps, roll and yaw on the branch nearest to `start` [deg].
Vectors roll_pitch_yaw(const std::vector<Quat>& rotations, std::optional<Vec3> start) {
  Vectors angles;
  for (const Quat& q : rotations) {
    Vec3 rpy = kDegrees * euler_angles(q);
    if (start)
      for (int axis : {0, 2}) rpy[axis] += 360.0 * std::round(((*start)[axis] - rpy[axis]) / 360.0);
    angles.push_back(rpy);
    start = rpy;
  }
  return angles;
}

std::vector<Quat> rotations_of(const std::vector<NavState>& states) {
  std::vector<Quat> out;
  for (const NavState& s : states) out.push_back(s.T_w_i.q);
  return out;
}

/// Standard deviations about the IMU's axes as those of the Euler angles, to first order [rad -> deg].
Vectors euler_sigmas(const std::vector<NavState>& states, const Vectors& sigma) {
  constexpr double kStep = 1e-5;
  Vectors out;
  for (std::size_t i = 0; i < sigma.size(); ++i) {
    const Quat& q = states[i].T_w_i.q;
    Vec3 variance = Vec3::Zero();
    for (int k = 0; k < 3; ++k) {
      const Vec3 turn = kStep * Vec3::Unit(k);
      Vec3 d = euler_angles(q * quat_exp(turn)) - euler_angles(q);
      for (double& angle : d) angle = std::remainder(angle, 2 * 180 / kDegrees);
      variance += (d * (sigma[i][k] / kStep)).cwiseAbs2();
    }
    out.push_back(kDegrees * variance.cwiseSqrt());
  }
  return out;
}

/// A trajectory of the camera as one of the IMU; empty where the mounting is not known.
Trajectory of_imu(const RunFolder& run, Trajectory camera) {
  if (!run.refined) return {};
  const Pose T_c_i = run.refined->T_i_c.inverse();
  for (StampedPose& pose : camera) pose.T = pose.T * T_c_i;
  return camera;
}

/// Poses on either side that a velocity is taken from.
std::size_t half_width(const Trajectory& trajectory) {
  const double interval =
      seconds_between(trajectory.front().t, trajectory.back().t) / static_cast<double>(trajectory.size() - 1);
  return static_cast<std::size_t>(std::clamp(std::round(kVelocityHalfSpan / interval), 1.0, 100.0));
}

struct Truth {
  Trajectory imu;
  Seconds t;
};

/// One vector of the state: smoothed, causal with its band, truth.
Panel vector_panel(const RunFolder& run, const std::string& title, const std::string& unit, double factor,
                   const AxisNames& sigmas, const std::function<Vec3(const NavState&)>& part, Time zero) {
  Panel panel{"state", title, unit, {}};
  const auto scaled = [&](const NavState& s) -> Vec3 { return factor * part(s); };
  Vectors band = sigmas_at(run.windows, run.states_causal, sigmas);
  for (Vec3& sigma : band) sigma *= factor;
  add_vectors(panel, kXyz, "", seconds_of(run.states, zero), vectors_of(run.states, scaled));
  add_vectors(panel, kXyz, "causal", seconds_of(run.states_causal, zero),
              vectors_of(run.states_causal, scaled), band);
  return panel;
}

Panel orientation_panel(const RunFolder& run, const Truth& truth, Time zero) {
  Panel panel{"state", "Orientation", "deg", {}};
  const Vectors angles = roll_pitch_yaw(rotations_of(run.states), {});
  const auto start = angles.empty() ? std::nullopt : std::optional(angles.front());
  add_vectors(panel, kRollPitchYaw, "", seconds_of(run.states, zero), angles);
  const Vectors sigma = sigmas_at(run.windows, run.states_causal, {"sigma_rx", "sigma_ry", "sigma_rz"});
  add_vectors(panel, kRollPitchYaw, "causal", seconds_of(run.states_causal, zero),
              roll_pitch_yaw(rotations_of(run.states_causal), start), euler_sigmas(run.states_causal, sigma));
  std::vector<Quat> true_rotations;
  for (const StampedPose& pose : truth.imu) true_rotations.push_back(pose.T.q);
  add_vectors(panel, kRollPitchYaw, "truth", truth.t, roll_pitch_yaw(true_rotations, start));
  return panel;
}

}  // namespace

std::vector<Panel> state_panels(const RunFolder& run, const AlignedTruth& aligned, Time zero) {
  const Trajectory imu = of_imu(run, aligned.camera);
  const Truth truth{imu, seconds_of(imu, zero)};
  std::vector<Panel> panels;
  panels.push_back(vector_panel(
      run, "Position", "m", 1, {"sigma_px", "sigma_py", "sigma_pz"},
      [](const NavState& s) { return s.T_w_i.p; }, zero));
  Vectors positions;
  for (const StampedPose& pose : truth.imu) positions.push_back(pose.T.p);
  add_vectors(panels.back(), kXyz, "truth", truth.t, positions);
  panels.push_back(orientation_panel(run, truth, zero));
  panels.push_back(vector_panel(
      run, "Velocity", "m/s", 1, {"sigma_vx", "sigma_vy", "sigma_vz"},
      [](const NavState& s) { return s.v_w; }, zero));
  if (truth.imu.size() > 2)
    add_vectors(panels.back(), kXyz, "truth", truth.t, smoothed_velocity(truth.imu, half_width(truth.imu)));
  panels.push_back(vector_panel(
      run, "Gyroscope bias", "deg/s", kDegrees, {"sigma_bgx", "sigma_bgy", "sigma_bgz"},
      [](const NavState& s) { return s.bias.gyro; }, zero));
  panels.push_back(vector_panel(
      run, "Accelerometer bias", "m/s\u00b2", 1, {"sigma_bax", "sigma_bay", "sigma_baz"},
      [](const NavState& s) { return s.bias.accel; }, zero));
  return panels;
}

std::vector<Panel> causal_error_panels(const RunFolder& run, Time zero) {
  Trajectory estimate;
  for (const NavState& s : run.states_causal) estimate.push_back({s.t, s.T_w_i});
  Trajectory truth = of_imu(run, run.groundtruth);
  if (estimate.empty() || truth.size() < 3) return {};
  const MatchedPoses matched = match_interpolated(estimate, truth);
  if (matched.size() == 0) return {};
  const Similarity A = align(select_poses(matched, matched.estimate.front().t, {.first = 1, .seconds = {}}),
                             AlignmentKind::kPosYaw)
                           .T;
  const Similarity back{1.0, A.R.transpose(), -(A.R.transpose() * A.t)};
  for (StampedPose& pose : truth) pose.T = back * pose.T;
  const Vectors speeds = smoothed_velocity(truth, half_width(truth));
  // Of the states that have a truth, in order.
  std::vector<NavState> states;
  Vectors position, rotation, velocity;
  std::size_t next = 0;
  for (std::size_t k = 0; k < matched.size(); ++k) {
    const StampedPose& at = matched.estimate[k];
    while (run.states_causal[next].t != at.t) ++next;
    const NavState& s = run.states_causal[next];
    const Pose true_pose = back * matched.groundtruth[k].T;
    const auto later = std::lower_bound(truth.begin(), truth.end(), at.t,
                                        [](const StampedPose& p, Time t) { return p.t < t; });
    const auto i =
        static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(later - truth.begin(), 1, std::ssize(truth) - 1));
    const double share = seconds_between(truth[i - 1].t, at.t) / seconds_between(truth[i - 1].t, truth[i].t);
    states.push_back(s);
    position.push_back(s.T_w_i.p - true_pose.p);
    rotation.push_back(kDegrees * quat_log(true_pose.q.conjugate() * s.T_w_i.q));
    velocity.push_back(s.v_w - ((1 - share) * speeds[i - 1] + share * speeds[i]));
  }
  std::vector<Panel> panels;
  const auto add = [&](const char* title, const char* unit, const Vectors& errors, double factor,
                       const AxisNames& columns) {
    Vectors sigma = sigmas_at(run.windows, states, columns);
    for (Vec3& v : sigma) v *= factor;
    panels.push_back({"error", title, unit, {}});
    add_vectors(panels.back(), kXyz, "error", seconds_of(states, zero), errors, sigma);
  };
  add("Causal position error by axis", "m", position, 1, {"sigma_px", "sigma_py", "sigma_pz"});
  add("Causal rotation error by axis of the IMU", "deg", rotation, kDegrees,
      {"sigma_rx", "sigma_ry", "sigma_rz"});
  add("Causal velocity error by axis", "m/s", velocity, 1, {"sigma_vx", "sigma_vy", "sigma_vz"});
  return panels;
}

}  // namespace idol
