#include "idol/report/curves.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

#include "idol/eval/metrics.hpp"

namespace idol {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
/// Half the span that ground truth is differentiated over: long enough for motion capture's noise [s].
constexpr double kVelocityHalfSpan = 0.025;
/// Buckets per curve: more than the page has pixels.
constexpr std::size_t kBuckets = 1200;

using Axes = std::array<const char*, 3>;
constexpr Axes kXyz = {"x", "y", "z"};

/// Three series out of one vector a sample.
void add_vectors(Panel& panel, const Axes& names, const std::string& style, const std::vector<double>& t,
                 const std::vector<Vec3>& values) {
  if (t.empty()) return;
  for (int axis = 0; axis < 3; ++axis) {
    Series s{names[static_cast<std::size_t>(axis)], axis, style, t, {}};
    for (const Vec3& v : values) s.y.push_back(v[axis]);
    panel.series.push_back(std::move(s));
  }
}

std::vector<double> seconds_of(const Trajectory& trajectory, Time zero) {
  std::vector<double> t;
  for (const StampedPose& pose : trajectory) t.push_back(seconds_between(zero, pose.t));
  return t;
}

std::vector<Vec3> positions_of(const Trajectory& trajectory) {
  std::vector<Vec3> p;
  for (const StampedPose& pose : trajectory) p.push_back(pose.T.p);
  return p;
}

/// z-y-x Euler angles, without jumps, roll and yaw on the branch nearest to `start` [deg].
std::vector<Vec3> roll_pitch_yaw(const Trajectory& trajectory, std::optional<Vec3> start) {
  std::vector<Vec3> angles;
  for (const StampedPose& pose : trajectory) {
    const Mat3 R = pose.T.R();
    Vec3 rpy(std::atan2(R(2, 1), R(2, 2)), -std::asin(std::clamp(R(2, 0), -1.0, 1.0)),
             std::atan2(R(1, 0), R(0, 0)));
    rpy *= kDegrees;
    if (start)
      for (int axis : {0, 2}) rpy[axis] += 360.0 * std::round(((*start)[axis] - rpy[axis]) / 360.0);
    angles.push_back(rpy);
    start = rpy;
  }
  return angles;
}

Panel position_panel(const RunFolder& run, const AlignedTruth& truth, Time zero) {
  Panel panel{"Camera position", "m", {}};
  add_vectors(panel, kXyz, "", seconds_of(run.camera, zero), positions_of(run.camera));
  add_vectors(panel, kXyz, "truth", seconds_of(truth.camera, zero), positions_of(truth.camera));
  return panel;
}

Panel orientation_panel(const RunFolder& run, const AlignedTruth& truth, Time zero) {
  constexpr Axes kNames = {"roll", "pitch", "yaw"};
  Panel panel{"Camera orientation", "deg", {}};
  const std::vector<Vec3> angles = roll_pitch_yaw(run.camera, {});
  add_vectors(panel, kNames, "", seconds_of(run.camera, zero), angles);
  const auto start = angles.empty() ? std::nullopt : std::optional(angles.front());
  add_vectors(panel, kNames, "truth", seconds_of(truth.camera, zero), roll_pitch_yaw(truth.camera, start));
  return panel;
}

/// Velocity of the IMU: the states' and, by differentiating its path, ground truth's.
Panel velocity_panel(const RunFolder& run, const AlignedTruth& truth, Time zero) {
  Panel panel{"IMU velocity", "m/s", {}};
  std::vector<double> t;
  std::vector<Vec3> v;
  for (const NavState& s : run.states) {
    t.push_back(seconds_between(zero, s.t));
    v.push_back(s.v_w);
  }
  add_vectors(panel, kXyz, "", t, v);
  const std::optional<Pose> T_i_c = mounting(run.camera, run.imu);
  const std::size_t n = truth.camera.size();
  if (!T_i_c || n < 3) return panel;
  Trajectory imu = truth.camera;
  for (StampedPose& pose : imu) pose.T = pose.T * T_i_c->inverse();
  const double interval = seconds_between(imu.front().t, imu.back().t) / static_cast<double>(n - 1);
  const auto half =
      static_cast<std::size_t>(std::clamp(std::round(kVelocityHalfSpan / interval), 1.0, 100.0));
  add_vectors(panel, kXyz, "truth", seconds_of(imu, zero), smoothed_velocity(imu, half));
  return panel;
}

Panel bias_panel(const RunFolder& run, const std::string& title, const std::string& unit, double factor,
                 const std::function<Vec3(const NavState&)>& bias, Time zero) {
  Panel panel{title, unit, {}};
  std::vector<double> t;
  std::vector<Vec3> b;
  for (const NavState& s : run.states) {
    t.push_back(seconds_between(zero, s.t));
    b.push_back(factor * bias(s));
  }
  add_vectors(panel, kXyz, "", t, b);
  return panel;
}

void add_error_panels(std::vector<Panel>& panels, const AlignedTruth& truth, const AlignedTruth& causal_truth,
                      Time zero) {
  Panel translation{"Translation error after alignment", "m", {}};
  Panel rotation{"Rotation error after alignment", "deg", {}};
  const auto add = [&](const AlignedTruth& aligned, const std::string& name, int colour,
                       const std::string& style) {
    if (aligned.matched.size() == 0) return;
    const AbsoluteErrors errors = absolute_errors(aligned.matched, aligned.alignment);
    const std::vector<double> t = seconds_of(aligned.matched.estimate, zero);
    translation.series.push_back({name, colour, style, t, errors.translation_m});
    rotation.series.push_back({name, colour, style, t, errors.rotation_deg});
  };
  add(causal_truth, "causal", 1, "thin");
  add(truth, "smoothed", 2, "");
  panels.push_back(std::move(translation));
  panels.push_back(std::move(rotation));
}

/// A panel of columns of windows.csv: {column, name, factor} each.
struct WindowCurve {
  const char* column;
  const char* name;
  double factor;
  const char* style = "";
};

Panel window_panel(const CsvColumns& windows, const std::string& title, const std::string& unit,
                   std::initializer_list<WindowCurve> curves, Time zero) {
  Panel panel{title, unit, {}};
  std::vector<double> t;
  for (Time stamp : windows.t) t.push_back(seconds_between(zero, stamp));
  int colour = 2;
  for (const WindowCurve& curve : curves) {
    const std::vector<double>* column = windows.find(curve.column);
    if (column != nullptr) {
      Series s{curve.name, colour, curve.style, t, *column};
      for (double& y : s.y) y *= curve.factor;
      panel.series.push_back(std::move(s));
    }
    colour = 0;
  }
  return panel;
}

}  // namespace

std::optional<Pose> mounting(const Trajectory& camera, const Trajectory& imu) {
  for (const StampedPose& c : camera) {
    const auto i =
        std::lower_bound(imu.begin(), imu.end(), c.t, [](const StampedPose& p, Time t) { return p.t < t; });
    if (i != imu.end() && i->t == c.t) return i->T.inverse() * c.T;
  }
  return std::nullopt;
}

AlignedTruth align_truth(const Trajectory& estimate, const Trajectory& groundtruth) {
  AlignedTruth out;
  out.matched = match_nearest(estimate, groundtruth);
  if (out.matched.size() == 0) return out;
  out.alignment = align(out.matched, AlignmentKind::kPosYaw).T;
  const Similarity& A = out.alignment;
  const Similarity back{1.0, A.R.transpose(), -(A.R.transpose() * A.t)};
  for (const StampedPose& pose : groundtruth)
    if (pose.t >= estimate.front().t && pose.t <= estimate.back().t)
      out.camera.push_back({pose.t, back * pose.T});
  return out;
}

std::vector<Panel> make_panels(const RunFolder& run, const AlignedTruth& truth,
                               const AlignedTruth& causal_truth, Time zero) {
  std::vector<Panel> panels;
  panels.push_back(position_panel(run, truth, zero));
  panels.push_back(orientation_panel(run, truth, zero));
  add_error_panels(panels, truth, causal_truth, zero);
  panels.push_back(velocity_panel(run, truth, zero));
  const CsvColumns& w = run.windows;
  panels.push_back(
      window_panel(w, "Distance of events to their lines, RMS", "px", {{"rms_px", "rms", 1}}, zero));
  panels.push_back(bias_panel(
      run, "Gyroscope bias", "deg/s", kDegrees, [](const NavState& s) { return s.bias.gyro; }, zero));
  panels.push_back(bias_panel(
      run, "Accelerometer bias", "m/s\u00b2", 1, [](const NavState& s) { return s.bias.accel; }, zero));
  panels.push_back(
      window_panel(w, "Mean track length of the lines in view", "s", {{"mean_track_s", "mean", 1}}, zero));
  panels.push_back(window_panel(w, "Segments and lines per window", "",
                                {{"lines", "lines", 1}, {"segments", "segments", 1}}, zero));
  panels.push_back(window_panel(w, "Events per window", "thousand", {{"events", "events", 1e-3}}, zero));
  panels.push_back(window_panel(
      w, "Solver time per window", "s",
      {{"solve_s", "solver", 1}, {"duration_s", "the window's own duration", 1, "dashed"}}, zero));
  panels.push_back(
      window_panel(w, "Residuals in the solve", "thousand", {{"residuals", "residuals", 1e-3}}, zero));
  panels.push_back(
      window_panel(w, "Solver iterations per window", "", {{"iterations", "iterations", 1}}, zero));
  std::erase_if(panels, [](const Panel& p) { return p.series.empty(); });
  for (Panel& panel : panels)
    for (Series& s : panel.series) s = thin(s, kBuckets);
  return panels;
}

std::vector<Vec3> smoothed_velocity(const Trajectory& trajectory, std::size_t half) {
  constexpr double kWidestSpan = 8 * kVelocityHalfSpan;  // beyond it there is a hole, not a motion
  std::vector<Vec3> velocity(trajectory.size(), Vec3::Constant(kNan));
  for (std::size_t i = half; i + half < trajectory.size(); ++i) {
    const Time centre = trajectory[i].t;
    double sum_t = 0, sum_tt = 0;
    Vec3 sum_p = Vec3::Zero(), sum_tp = Vec3::Zero();
    for (std::size_t j = i - half; j <= i + half; ++j) {
      const double t = seconds_between(centre, trajectory[j].t);
      const Vec3 p = trajectory[j].T.p - trajectory[i].T.p;
      sum_t += t;
      sum_tt += t * t;
      sum_p += p;
      sum_tp += t * p;
    }
    const auto n = static_cast<double>(2 * half + 1);
    const double spread = sum_tt - sum_t * sum_t / n;
    if (spread <= 0 || seconds_between(trajectory[i - half].t, trajectory[i + half].t) > kWidestSpan)
      continue;
    velocity[i] = (sum_tp - sum_p * (sum_t / n)) / spread;
  }
  return velocity;
}

Series thin(const Series& series, std::size_t buckets) {
  const std::size_t n = series.t.size();
  if (n <= 2 * buckets) return series;
  Series out{series.name, series.colour, series.style, {}, {}};
  const auto keep = [&](std::size_t i) {
    out.t.push_back(series.t[i]);
    out.y.push_back(series.y[i]);
  };
  for (std::size_t k = 0; k < buckets; ++k) {
    const std::size_t begin = k * n / buckets, end = (k + 1) * n / buckets;
    std::size_t low = begin, high = begin;  // a gap only if there is nothing else
    for (std::size_t i = begin + 1; i < end; ++i) {
      if (std::isnan(series.y[low]) || series.y[i] < series.y[low]) low = i;
      if (std::isnan(series.y[high]) || series.y[i] > series.y[high]) high = i;
    }
    keep(std::min(low, high));
    if (low != high) keep(std::max(low, high));
  }
  return out;
}

}  // namespace idol
