// Figures against time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "idol/report/figure_makers.hpp"

namespace idol {
namespace {

constexpr const char* kTime = "time [s]";
constexpr std::array<Rgb, 3> kColours = {ink::kVermillion, ink::kGreen, ink::kBlue};

const Panel* find_panel(const FigureSource& source, const std::string& title) {
  for (const Panel& panel : source.panels)
    if (panel.title == title) return &panel;
  return nullptr;
}

/// Adds a curve, its band below it.
void add_series(Plot& plot, const Series& series, const std::string& name, const Pen& pen, double factor,
                const std::string& band_name, double band_alpha) {
  PlotCurve curve{name, series.t, series.y, pen};
  for (double& y : curve.y) y *= factor;
  if (!series.band.empty()) {
    PlotBand band{band_name, series.t, curve.y, curve.y, {pen.ink.colour, band_alpha}};
    for (std::size_t i = 0; i < series.band.size(); ++i) {
      band.low[i] -= factor * series.band[i];
      band.high[i] += factor * series.band[i];
    }
    plot.bands.push_back(std::move(band));
  }
  plot.curves.push_back(std::move(curve));
}

/// One plot an axis of a panel of the state: truth, causal with its band, smoothed.
Figure by_axis(const FigureSource& source, const std::string& title) {
  const Panel* panel = find_panel(source, title);
  if (panel == nullptr) return {.plots = {}, .needs = "states.csv or states_causal.csv"};
  Figure figure{{}, 210, {}};
  for (int axis = 0; axis < 3; ++axis) {
    Plot plot{.x_label = kTime};
    const auto add = [&](const std::string& style, const std::string& name, const Pen& pen) {
      for (const Series& series : panel->series) {
        if (series.colour != axis || series.style != style) continue;
        plot.y_label = fmt::format("{} [{}]", series.name, panel->unit);
        add_series(plot, series, name, pen, 1, "3\u03c3", 0.2);
      }
    };
    add("truth", "ground truth", {{ink::kGrey, 0.55}, 2.2});
    add("causal", "causal", {{ink::kVermillion}, 0.6});
    add("", "smoothed", {{ink::kBlue}, 0.8});
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

double largest(const Panel& panel) {
  double most = 0;
  for (const Series& series : panel.series)
    for (double y : series.y) most = std::fmax(most, std::abs(y));
  return most;
}

}  // namespace

Figure position_figure(const FigureSource& source, double) { return by_axis(source, "Position"); }

Figure orientation_figure(const FigureSource& source, double) { return by_axis(source, "Orientation"); }

Figure velocity_figure(const FigureSource& source, double) { return by_axis(source, "Velocity"); }

Figure bias_figure(const FigureSource& source, double) {
  Figure figure{{}, 230, "states.csv or states_causal.csv"};
  for (const auto& [title, name] :
       {std::pair{"Gyroscope bias", "gyroscope"}, std::pair{"Accelerometer bias", "accelerometer"}}) {
    const Panel* panel = find_panel(source, title);
    if (panel == nullptr) continue;
    Plot plot{.x_label = kTime, .y_label = fmt::format("{} [{}]", name, panel->unit)};
    // Six curves in one plot are too many: the causal ones, which change and have bands, if there are any.
    const bool causal = std::any_of(panel->series.begin(), panel->series.end(),
                                    [](const Series& s) { return s.style == "causal"; });
    for (const Series& series : panel->series)
      if ((series.style == "causal") == causal)
        add_series(plot, series, series.name, {{kColours[static_cast<std::size_t>(series.colour)]}}, 1,
                   "3\u03c3", 0.15);
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
  const auto add = [&](const Panel& panel, const char* label, double factor) {
    Plot plot{.x_label = kTime, .y_label = label, .y_from_zero = true};
    for (const Series& series : panel.series) {
      const bool causal = series.name == "causal";
      add_series(plot, series, series.name, {{causal ? ink::kVermillion : ink::kBlue}, causal ? 0.6 : 0.8},
                 factor, "", 0);
    }
    figure.plots.push_back(std::move(plot));
  };
  add(*translation, small ? "translation [mm]" : "translation [m]", small ? 1000 : 1);
  add(*rotation, "rotation [deg]", 1);
  return figure;
}

Figure consistency_figure(const FigureSource& source, double) {
  struct Kind {
    const char *title, *label;
    double factor;
  };
  Figure figure{{},
                40,
                "groundtruth_camera.txt, states_causal.csv, and the standard deviations of windows.csv "
                "(the fixed-lag estimator has them)"};
  for (const Kind& kind : {Kind{"Causal position error by axis", "{} [mm]", 1000},
                           Kind{"Causal rotation error by axis of the IMU", "\u03b8{} [deg]", 1},
                           Kind{"Causal velocity error by axis", "v{} [m/s]", 1}}) {
    const Panel* panel = find_panel(source, kind.title);
    if (panel == nullptr) continue;
    for (const Series& series : panel->series) {
      if (series.band.empty()) continue;
      Plot plot{.x_label = kTime, .y_label = fmt::format(fmt::runtime(kind.label), series.name)};
      Series zero = series;
      std::fill(zero.y.begin(), zero.y.end(), 0.0);
      add_series(plot, zero, "", {{ink::kSky}, 0.5}, kind.factor, "3\u03c3", 0.4);
      zero.band.clear();
      zero.y = series.y;
      add_series(plot, zero, "error of the causal estimate", {{ink::kBlue}, 0.8}, kind.factor, "", 0);
      figure.plots.push_back(std::move(plot));
      figure.height += 50;
    }
  }
  return figure;
}

Figure health_figure(const FigureSource& source, double) {
  struct Kind {
    const char *title, *label;
    double factor = 1;
  };
  Figure figure{{}, 30, "windows.csv"};
  for (const Kind& kind :
       {Kind{"Event rate", "rate [Mev/s]", 1e-3}, Kind{"Tracks in the window", "tracks"},
        Kind{"Mean track length of the lines in view", "track [s]"},
        Kind{"Distance of events to their lines, RMS", "rms [px]"},
        Kind{"Computing time per window", "time [ms]"}, Kind{"Latency of each pose", "latency [ms]"}}) {
    const Panel* panel = find_panel(source, kind.title);
    if (panel == nullptr) continue;
    Plot plot{.x_label = kTime, .y_label = kind.label, .y_from_zero = true};
    constexpr std::array<Rgb, 4> kOrder = {ink::kBlue, ink::kVermillion, ink::kGreen, ink::kPurple};
    for (const Series& series : panel->series) {
      Pen pen{{kOrder[plot.curves.size() % kOrder.size()]}};
      if (series.style == "dashed") pen = {{ink::kGrey}, 0.8, 3, 2};
      add_series(plot, series, panel->series.size() > 1 ? series.name : "", pen, kind.factor, "", 0);
    }
    figure.height += panel->series.size() > 1 ? 69 : 58;
    figure.plots.push_back(std::move(plot));
  }
  return figure;
}

}  // namespace idol
