// Figures against time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "idol/report/figure_makers.hpp"

namespace idol {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr const char* kTime = "time [s]";
constexpr std::array<Rgb, 3> kColours = {ink::kVermillion, ink::kGreen, ink::kBlue};
constexpr const char* kBand = "3\u03c3 when published";

constexpr Pen kTruth{{ink::kGrey, 0.55}, 2.2};

const Panel* find_panel(const FigureSource& source, const std::string& title) {
  for (const Panel& panel : source.panels)
    if (panel.title == title) return &panel;
  return nullptr;
}

std::string with_unit(const std::string& what, const std::string& unit) {
  return unit.empty() ? what : fmt::format("{} [{}]", what, unit);
}

PlotCurve curve_of(const Series& series, double factor = 1) {
  PlotCurve curve{series.name, series.t, series.y, {{kColours[static_cast<std::size_t>(series.colour)]}}};
  for (double& y : curve.y) y *= factor;
  if (series.style == "truth") {
    curve.name = "ground truth";
    curve.pen = kTruth;
  }
  if (series.style == "thin") curve.pen.width = 0.6;
  if (series.style == "dashed") curve.pen = {{ink::kGrey}, 0.8, 3, 2};
  return curve;
}

/// Linear between samples, NaN beyond them. Times rise.
double value_at(const std::vector<double>& x, const std::vector<double>& y, double at) {
  const auto above = std::lower_bound(x.begin(), x.end(), at);
  if (above == x.end()) return kNan;
  const auto i = static_cast<std::size_t>(above - x.begin());
  if (*above == at) return y[i];
  if (i == 0) return kNan;
  return y[i - 1] + (at - x[i - 1]) / (x[i] - x[i - 1]) * (y[i] - y[i - 1]);
}

/// Three standard deviations of a column of windows.csv around a curve; nothing where the run knew none.
PlotBand band_around(const FigureSource& source, const PlotCurve& curve, const std::string& column,
                     double factor, double alpha) {
  PlotBand band{kBand, {}, {}, {}, {curve.pen.ink.colour, alpha}};
  const std::vector<double>* sigma = source.run.windows.find(column);
  if (sigma == nullptr) return band;
  for (std::size_t i = 0; i < sigma->size(); ++i) {
    const double t = seconds_between(source.zero, source.run.windows.t[i]);
    const double half = (*sigma)[i] > 0 ? 3 * factor * (*sigma)[i] : kNan;
    const double y = value_at(curve.x, curve.y, t);
    band.x.push_back(t);
    band.low.push_back(y - half);
    band.high.push_back(y + half);
  }
  return band;
}

/// A band without a single number is no band, and has no place in the legend.
void add_band(Plot& plot, PlotBand band) {
  if (std::any_of(band.high.begin(), band.high.end(), [](double v) { return std::isfinite(v); }))
    plot.bands.push_back(std::move(band));
}

/// One plot an axis of a panel of three: estimate over ground truth, with the bands of columns `sigma` + x, y
/// or z.
Figure by_axis(const FigureSource& source, const std::string& title, const std::string& needs,
               const std::array<const char*, 3>& names, const std::string& sigma) {
  const Panel* panel = find_panel(source, title);
  if (panel == nullptr) return {.plots = {}, .needs = needs};
  Figure figure{{}, 210, {}};
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    Plot plot{.x_label = kTime, .y_label = with_unit(names[a], panel->unit)};
    PlotCurve estimate;
    for (const Series& series : panel->series) {
      if (series.colour != axis) continue;
      if (series.style == "truth")
        plot.curves.push_back(curve_of(series));
      else
        estimate = curve_of(series);
    }
    estimate.name = "estimate";
    estimate.pen.ink.colour = ink::kBlue;
    if (!sigma.empty()) add_band(plot, band_around(source, estimate, sigma + "xyz"[axis], 1, 0.25));
    plot.curves.push_back(std::move(estimate));
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

/// The series of a panel in one plot.
Plot plot_of(const Panel& panel, const std::string& y_label, double factor = 1) {
  Plot plot{.x_label = kTime, .y_label = y_label};
  for (const Series& series : panel.series) plot.curves.push_back(curve_of(series, factor));
  return plot;
}

double largest(const Panel& panel) {
  double most = 0;
  for (const Series& series : panel.series)
    for (double y : series.y) most = std::fmax(most, std::abs(y));
  return most;
}

}  // namespace

Figure position_figure(const FigureSource& source, double) {
  return by_axis(source, "Camera position", "trajectory_camera.txt", {"x", "y", "z"}, "sigma_p");
}

Figure orientation_figure(const FigureSource& source, double) {
  // Standard deviations are about the IMU's axes, so these curves have no bands; figure 'consistency' shows
  // them.
  return by_axis(source, "Camera orientation", "trajectory_camera.txt", {"roll", "pitch", "yaw"}, "");
}

Figure velocity_figure(const FigureSource& source, double) {
  return by_axis(source, "IMU velocity", "states.csv", {"x", "y", "z"}, "sigma_v");
}

Figure bias_figure(const FigureSource& source, double) {
  struct Half {
    const char *title, *name, *sigma;
    double factor;
  };
  Figure figure{{}, 230, "states.csv"};
  for (const Half& half : {Half{"Gyroscope bias", "gyroscope", "sigma_bg", kDegrees},
                           Half{"Accelerometer bias", "accelerometer", "sigma_ba", 1}}) {
    const Panel* panel = find_panel(source, half.title);
    if (panel == nullptr) continue;
    Plot plot = plot_of(*panel, with_unit(half.name, panel->unit));
    for (int axis = 0; axis < 3; ++axis)
      add_band(plot, band_around(source, plot.curves[static_cast<std::size_t>(axis)],
                                 half.sigma + std::string(1, "xyz"[axis]), half.factor, 0.15));
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

Figure error_figure(const FigureSource& source, double) {
  const Panel* translation = find_panel(source, "Translation error after alignment");
  const Panel* rotation = find_panel(source, "Rotation error after alignment");
  if (translation == nullptr || rotation == nullptr)
    return {.plots = {}, .needs = "groundtruth_camera.txt and a trajectory of its time"};
  const bool small = largest(*translation) < 0.1;
  Figure figure{{}, 170, {}};
  figure.plots.push_back(
      plot_of(*translation, small ? "translation [mm]" : "translation [m]", small ? 1000 : 1));
  figure.plots.push_back(plot_of(*rotation, "rotation [deg]"));
  for (Plot& plot : figure.plots) {
    plot.y_from_zero = true;
    for (PlotCurve& curve : plot.curves)
      curve.pen.ink.colour = curve.name == "causal" ? ink::kVermillion : ink::kBlue;
  }
  return figure;
}

Figure consistency_figure(const FigureSource& source, double) {
  const MatchedPoses& pairs = source.causal_truth.matched;
  const std::vector<double>* known = source.run.windows.find("sigma_px");
  const bool sigmas =
      known != nullptr && std::any_of(known->begin(), known->end(), [](double s) { return s > 0; });
  const auto T_i_c = mounting(source.run.camera_causal, source.run.imu_causal);
  if (pairs.size() < 2 || !sigmas || !T_i_c)
    return {
        .plots = {},
        .needs =
            "groundtruth_camera.txt, both causal trajectories, and the standard deviations of windows.csv "
            "(the fixed-lag estimator has them)"};
  // The estimate knows its world from its first pose on, so that one lies on the truth.
  const Similarity A = align(select_poses(pairs, pairs.estimate.front().t, {.first = 1, .seconds = {}}),
                             AlignmentKind::kPosYaw)
                           .T;
  std::array<PlotCurve, 6> errors;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    // The truth in the estimate's world; position along its axes, rotation about the IMU's.
    const Pose& estimate = pairs.estimate[i].T;
    const Pose truth{Quat(A.R.transpose()) * pairs.groundtruth[i].T.q,
                     A.R.transpose() * (pairs.groundtruth[i].T.p - A.t)};
    const Vec3 p = 1000 * (estimate.p - truth.p);
    const Vec3 r = kDegrees * (T_i_c->q * quat_log(truth.q.conjugate() * estimate.q));
    for (int axis = 0; axis < 3; ++axis) {
      errors[static_cast<std::size_t>(axis)].y.push_back(p[axis]);
      errors[static_cast<std::size_t>(axis) + 3].y.push_back(r[axis]);
    }
    for (PlotCurve& curve : errors) curve.x.push_back(seconds_between(source.zero, pairs.estimate[i].t));
  }
  Figure figure{{}, 330, {}};
  for (std::size_t k = 0; k < 6; ++k) {
    const char axis = "xyz"[k % 3];
    Plot plot{.x_label = kTime,
              .y_label = k < 3 ? fmt::format("{} [mm]", axis) : fmt::format("\u03b8{} [deg]", axis)};
    PlotCurve zero{"", errors[k].x, std::vector<double>(pairs.size(), 0.0), {{ink::kSky}, 0.5}};
    add_band(plot, band_around(source, zero, (k < 3 ? "sigma_p" : "sigma_r") + std::string(1, axis),
                               k < 3 ? 1000 : kDegrees, 0.35));
    for (PlotBand& band : plot.bands) band.name = "3\u03c3";
    errors[k].name = "error of the causal trajectory";
    errors[k].pen = {{ink::kBlue}, 0.8};
    plot.curves = {std::move(zero), std::move(errors[k])};
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

Figure health_figure(const FigureSource& source, double) {
  Figure figure{{}, 0, "windows.csv"};
  const CsvColumns& windows = source.run.windows;
  const auto* events = windows.find("events");
  const auto* duration = windows.find("duration_s");
  if (events != nullptr && duration != nullptr) {
    Plot plot{.x_label = kTime, .y_label = "rate [Mev/s]", .y_from_zero = true};
    PlotCurve rate{"", {}, {}, {{ink::kBlue}}};
    for (std::size_t i = 0; i < events->size(); ++i) {
      rate.x.push_back(seconds_between(source.zero, windows.t[i]));
      rate.y.push_back((*duration)[i] > 0 ? 1e-6 * (*events)[i] / (*duration)[i] : kNan);
    }
    plot.curves.push_back(std::move(rate));
    figure.plots.push_back(std::move(plot));
  }
  const auto add = [&](const char* title, const char* label, double factor) {
    const Panel* panel = find_panel(source, title);
    if (panel == nullptr) return;
    Plot plot = plot_of(*panel, label, factor);
    plot.y_from_zero = true;
    if (plot.curves.size() == 1) plot.curves[0].name.clear();
    figure.plots.push_back(std::move(plot));
  };
  add("Segments and lines per window", "number", 1);
  add("Mean track length of the lines in view", "track [s]", 1);
  add("Distance of events to their lines, RMS", "rms [px]", 1);
  add("Solver time per window", "time [ms]", 1000);
  if (const auto* latency = windows.find("latency_s")) {
    Plot plot{.x_label = kTime, .y_label = "latency [ms]", .y_from_zero = true};
    PlotCurve curve{"", {}, {}, {{ink::kBlue}}};
    for (std::size_t i = 0; i < latency->size(); ++i) {
      curve.x.push_back(seconds_between(source.zero, windows.t[i]));
      curve.y.push_back(1000 * (*latency)[i]);
    }
    plot.curves.push_back(std::move(curve));
    figure.plots.push_back(std::move(plot));
  }
  figure.height = 30 + 58 * static_cast<double>(figure.plots.size());
  return figure;
}

}  // namespace idol
