// Figures in space, and statistics.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/eval/protocols.hpp"
#include "idol/report/figure_makers.hpp"
#include "idol/report/plot_marks.hpp"

namespace idol {
namespace {

constexpr double kHighest = 0.62;  ///< of a view, as a share of the figure's width

/// Two views of a scene: from above, and from the side along the horizontal axis in which it is smaller.
struct Views {
  int across;  ///< axis to the right in both: 0 or 1

  /// `low` and `high` are the scene's corners.
  Views(const Vec3& low, const Vec3& high) : across(high.x() - low.x() >= high.y() - low.y() ? 0 : 1) {}

  /// An empty plot of the view. From above with y to the right, x points down: else left and right were
  /// swapped.
  [[nodiscard]] Plot plot(bool from_above) const {
    const auto axis = [](int i) { return fmt::format("{} [m]", "xyz"[i]); };
    return {.x_label = axis(across),
            .y_label = axis(upwards(from_above)),
            .equal = true,
            .y_down = from_above && across == 1};
  }
  [[nodiscard]] int upwards(bool from_above) const { return from_above ? 1 - across : 2; }
  [[nodiscard]] PlotCurve project(const Trajectory& path, bool from_above) const {
    PlotCurve curve;
    for (const StampedPose& pose : path) {
      curve.x.push_back(pose.T.p[across]);
      curve.y.push_back(pose.T.p[upwards(from_above)]);
    }
    return curve;
  }
};

void add_path(Plot& plot, const Views& views, bool from_above, const Trajectory& path,
              const std::string& name, const Pen& pen) {
  if (path.empty()) return;
  PlotCurve curve = views.project(path, from_above);
  curve.name = name;
  curve.pen = pen;
  plot.curves.push_back(std::move(curve));
}

/// Both views, each as high as its content at one scale.
Figure two_views(Plot above, Plot side, double width) {
  Figure figure;
  double height = 0;
  for (Plot* plot : {&above, &side}) {
    plot->share = equal_height(*plot, width, kHighest * width);
    height += plot->share + 30;
    figure.plots.push_back(std::move(*plot));
  }
  figure.height = height;
  return figure;
}

struct Corners {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = -low;

  void add(const Trajectory& path) {
    for (const StampedPose& pose : path) {
      low = low.cwiseMin(pose.T.p);
      high = high.cwiseMax(pose.T.p);
    }
  }
};

/// Relative errors over pieces of the path, as protocol 'segments' has them.
RelativeErrors piece_errors(const MatchedPoses& pairs, int percent, double path_m) {
  return relative_errors(pairs, segment_length(percent, path_m), 1.0);
}

}  // namespace

Figure trajectory_figure(const FigureSource& source, double width) {
  const RunFolder& run = source.run;
  if (run.camera.size() < 2) return {.plots = {}, .needs = "trajectory_camera.txt"};
  Corners corners;
  for (const Trajectory* path : {&run.camera, &source.truth.camera}) corners.add(*path);
  const Views views(corners.low, corners.high);
  const auto view = [&](bool from_above) {
    Plot plot = views.plot(from_above);
    add_path(plot, views, from_above, source.truth.camera, "ground truth", {{ink::kGrey, 0.55}, 2.2});
    add_path(plot, views, from_above, run.camera_causal, "causal", {{ink::kVermillion}, 0.6});
    add_path(plot, views, from_above, run.camera, "smoothed", {{ink::kBlue}, 0.8});
    PlotCurve start = views.project({run.camera.front()}, from_above);
    start.name = "start";
    start.dot = 2;
    plot.curves.push_back(std::move(start));
    return plot;
  };
  return two_views(view(true), view(false), width);
}

Figure map_figure(const FigureSource& source, double width) {
  const std::vector<Line>& lines = source.run.lines;
  if (lines.empty()) return {.plots = {}, .needs = "lines.csv with lines"};
  // A few ends run far off where the depth is weak: the middle 96 % and the path decide what is shown.
  constexpr double kTail = 0.02;
  Corners corners;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> ends;
    for (const Line& line : lines) ends.insert(ends.end(), {line.a[axis], line.b[axis]});
    corners.low[axis] = finite_quantile(ends, kTail);
    corners.high[axis] = finite_quantile(ends, 1 - kTail);
  }
  const Views views(corners.low, corners.high);  // of the lines alone: a wall is seen from the front
  corners.add(source.run.camera);
  const auto view = [&](bool from_above) {
    Plot plot = views.plot(from_above);
    const auto range = [&](int axis) {
      const double pad = 0.04 * (corners.high[axis] - corners.low[axis]) + 0.02;
      return std::pair(corners.low[axis] - pad, corners.high[axis] + pad);
    };
    plot.x_range = range(views.across);
    plot.y_range = range(views.upwards(from_above));
    for (const Line& line : lines) {
      // What few windows saw is faint.
      const double alpha = std::clamp(0.05 * line.windows, 0.15, 1.0);
      const int up = views.upwards(from_above);
      plot.curves.push_back({"",
                             {line.a[views.across], line.b[views.across]},
                             {line.a[up], line.b[up]},
                             {{ink::kBlack, alpha}, 0.6}});
    }
    PlotCurve sample{"line (faint: seen in few windows)", {}, {}, {{ink::kBlack}, 0.6}};
    plot.curves.insert(plot.curves.begin(), std::move(sample));
    add_path(plot, views, from_above, source.run.camera, "camera", {{ink::kBlue}, 0.9});
    return plot;
  };
  return two_views(view(true), view(false), width);
}

Figure segment_figure(const FigureSource& source, double) {
  const MatchedPoses& smoothed = source.truth.matched;
  if (smoothed.size() < 2)
    return {.plots = {}, .needs = "groundtruth_camera.txt and a trajectory of its time"};
  const double path_m = path_length(source.run.groundtruth);
  Plot translation{.x_label = "length of the pieces: 10 to 50 % of the path",
                   .y_label = "translation [%]",
                   .y_from_zero = true};
  Plot rotation{.x_label = translation.x_label, .y_label = "rotation [deg]", .y_from_zero = true};
  constexpr double kWidth = 0.28;
  double place = 0;
  for (const int percent : kSegmentPercents) {
    place += 1;
    const auto add = [&](const MatchedPoses& pairs, const std::string& name, double shift, Rgb colour) {
      if (pairs.size() < 2) return;
      const RelativeErrors errors = piece_errors(pairs, percent, path_m);
      translation.boxes.push_back({name, place + shift, kWidth, errors.translation_percent, {colour}});
      rotation.boxes.push_back({name, place + shift, kWidth, errors.rotation_deg, {colour}});
    };
    add(source.causal_truth.matched, "causal", -0.17, ink::kOrange);
    add(smoothed, "smoothed", 0.17, ink::kSky);
    const std::string name = fmt::format("{:.2f} m", segment_length(percent, path_m));
    for (Plot* plot : {&translation, &rotation}) plot->x_names.emplace_back(place, name);
  }
  Figure figure{{}, 200, {}};
  for (Plot* plot : {&translation, &rotation}) {
    plot->x_range = {0.5, place + 0.5};
    figure.plots.push_back(std::move(*plot));
  }
  return figure;
}

}  // namespace idol
