#include "idol/report/curves.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "idol/eval/metrics.hpp"
#include "idol/report/state_curves.hpp"

namespace idol {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
/// Buckets per curve: more than the page has pixels.
constexpr std::size_t kBuckets = 1200;

std::vector<double> seconds_of(const Trajectory& trajectory, Time zero) {
  std::vector<double> t;
  for (const StampedPose& pose : trajectory) t.push_back(seconds_between(zero, pose.t));
  return t;
}

void add_error_panels(std::vector<Panel>& panels, const AlignedTruth& truth, const AlignedTruth& causal_truth,
                      Time zero) {
  Panel translation{"error", "Translation error after alignment", "m", {}};
  Panel rotation{"error", "Rotation error after alignment", "deg", {}};
  const auto add = [&](const AlignedTruth& aligned, const std::string& name, int colour,
                       const std::string& style) {
    if (aligned.matched.size() == 0) return;
    const AbsoluteErrors errors = absolute_errors(aligned.matched, aligned.alignment);
    const std::vector<double> t = seconds_of(aligned.matched.estimate, zero);
    translation.series.push_back({name, colour, style, t, errors.translation_m, {}});
    rotation.series.push_back({name, colour, style, t, errors.rotation_deg, {}});
  };
  add(causal_truth, "causal", 1, "thin");
  add(truth, "smoothed", 2, "");
  panels.push_back(std::move(translation));
  panels.push_back(std::move(rotation));
}

/// A column of windows.csv as a curve, or of several their quotient.
struct WindowCurve {
  const char* column;
  const char* name;
  double factor;
  const char* style = "";
  const char* per = nullptr;  ///< column to divide by
};

/// Columns without a single number are left out.
Panel window_panel(const CsvColumns& windows, const char* group, const std::string& title,
                   const std::string& unit, std::initializer_list<WindowCurve> curves, Time zero) {
  Panel panel{group, title, unit, {}};
  std::vector<double> t;
  for (Time stamp : windows.t) t.push_back(seconds_between(zero, stamp));
  int colour = -1;
  for (const WindowCurve& curve : curves) {
    ++colour;
    const std::vector<double>* column = windows.find(curve.column);
    const std::vector<double>* per = curve.per != nullptr ? windows.find(curve.per) : nullptr;
    if (column == nullptr || (curve.per != nullptr && per == nullptr)) continue;
    Series s{curve.name, colour, curve.style, t, *column, {}};
    for (std::size_t i = 0; i < s.y.size(); ++i) {
      s.y[i] *= curve.factor;
      if (per != nullptr) s.y[i] = (*per)[i] > 0 ? s.y[i] / (*per)[i] : kNan;
    }
    if (std::any_of(s.y.begin(), s.y.end(), [](double y) { return std::isfinite(y); }))
      panel.series.push_back(std::move(s));
  }
  return panel;
}

void add_window_panels(std::vector<Panel>& panels, const CsvColumns& w, Time zero) {
  const auto add = [&](const char* group, const char* title, const char* unit,
                       std::initializer_list<WindowCurve> curves) {
    panels.push_back(window_panel(w, group, title, unit, curves, zero));
  };
  constexpr const char* kFront = "front-end";
  constexpr const char* kBack = "back-end";
  add(kFront, "Event rate", "thousand/s", {{"events", "events", 1e-3, "", "duration_s"}});
  add(kFront, "What became of the events", "%",
      {{"in_segments", "kept: in segments", 100, "", "events"},
       {"unsupported", "noise", 100, "", "events"},
       {"flicker", "flicker", 100, "", "events"},
       {"hot", "hot pixels", 100, "", "events"},
       {"thinned", "thinned", 100, "", "events"}});
  add(kFront, "Tracks in the window", "",
      {{"segments", "segments", 1}, {"lines_seen", "of these mapped lines", 1}});
  add(kFront, "Mean track length of the lines in view", "s", {{"mean_track_s", "track length", 1}});
  add(kFront, "Image speed of the segments, median", "px/s", {{"speed_px_s", "speed", 1}});
  add(kBack, "Distance of events to their lines, RMS", "px", {{"rms_px", "rms", 1}});
  add(kBack, "Inliers: segments that hold as lines", "%", {{"lines_seen", "inliers", 100, "", "segments"}});
  add(kBack, "Computing time per window", "ms",
      {{"solve_s", "solver", 1e3},
       {"segment_s", "front-end", 1e3},
       {"integrate_s", "IMU integration", 1e3},
       {"duration_s", "the window's own duration", 1e3, "dashed"}});
  add(kBack, "Latency of each pose", "ms", {{"latency_s", "latency", 1e3}});
  add(kBack, "Residuals in the solve", "thousand", {{"residuals", "residuals", 1e-3}});
  add(kBack, "Solver iterations per window", "", {{"iterations", "iterations", 1}});
}

}  // namespace

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
  std::vector<Panel> panels = state_panels(run, truth, zero);
  add_error_panels(panels, truth, causal_truth, zero);
  for (Panel& panel : causal_error_panels(run, zero)) panels.push_back(std::move(panel));
  add_window_panels(panels, run.windows, zero);
  std::erase_if(panels, [](const Panel& p) { return p.series.empty(); });
  for (Panel& panel : panels)
    for (Series& s : panel.series) s = thin(s, kBuckets);
  return panels;
}

std::vector<Vec3> smoothed_velocity(const Trajectory& trajectory, std::size_t half) {
  constexpr double kWidestSpan = 0.2;  // [s]: beyond it there is a hole, not a motion
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
  Series out{series.name, series.colour, series.style, {}, {}, {}};
  const auto keep = [&](std::size_t i) {
    out.t.push_back(series.t[i]);
    out.y.push_back(series.y[i]);
    if (!series.band.empty()) out.band.push_back(series.band[i]);
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
