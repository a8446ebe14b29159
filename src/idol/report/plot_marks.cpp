#include "idol/report/plot_marks.hpp"

#include <algorithm>
#include <cmath>

namespace idol {
namespace {

double quantile(const std::vector<double>& sorted, double share) {
  const double place = share * static_cast<double>(sorted.size() - 1);
  const auto i = static_cast<std::size_t>(place);
  if (i + 1 >= sorted.size()) return sorted.back();
  return sorted[i] + (place - static_cast<double>(i)) * (sorted[i + 1] - sorted[i]);
}

void draw_curve(Canvas& canvas, const Axes& axes, const PlotCurve& curve) {
  std::vector<Vec2> points;
  for (std::size_t i = 0; i < curve.x.size(); ++i) points.push_back(axes.place(curve.x[i], curve.y[i]));
  if (curve.dot <= 0) return canvas.line(points, curve.pen);
  for (const Vec2& p : points)
    if (p.allFinite()) canvas.disc(p, curve.dot, curve.pen.ink);
}

void draw_band(Canvas& canvas, const Axes& axes, const PlotBand& band) {
  for (std::size_t begin = 0; begin < band.x.size();) {
    std::vector<Vec2> outline;
    std::size_t end = begin;
    for (; end < band.x.size() && std::isfinite(band.low[end]) && std::isfinite(band.high[end]); ++end)
      outline.push_back(axes.place(band.x[end], band.high[end]));
    for (std::size_t i = end; i-- > begin;) outline.push_back(axes.place(band.x[i], band.low[i]));
    if (outline.size() > 2) canvas.polygon(outline, band.ink);
    begin = end + 1;
  }
}

void draw_box(Canvas& canvas, const Axes& axes, const PlotBox& box) {
  if (box.values.empty()) return;
  const BoxFigures f = box_figures(box.values);
  const Pen pen{{ink::kBlack}, 0.6};
  const double left = box.x - 0.5 * box.width, right = box.x + 0.5 * box.width;
  const auto level = [&](double from, double to, double y, const Pen& with) {
    canvas.line(axes.place(from, y), axes.place(to, y), with);
  };
  for (const auto& [end, from] : {std::pair{f.low, f.first}, std::pair{f.high, f.third}}) {
    canvas.line(axes.place(box.x, end), axes.place(box.x, from), pen);
    level(box.x - 0.2 * box.width, box.x + 0.2 * box.width, end, pen);
  }
  const Vec2 upper = axes.place(left, f.third), lower = axes.place(right, f.first);
  const std::vector<Vec2> outline = {upper, {lower.x(), upper.y()}, lower, {upper.x(), lower.y()},
                                     upper, {lower.x(), upper.y()}};
  canvas.polygon(outline, box.ink);
  canvas.line(outline, pen);
  level(left, right, f.median, {{ink::kBlack}, 1.2});
}

}  // namespace

BoxFigures box_figures(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {quantile(values, 0.05), quantile(values, 0.25), quantile(values, 0.5), quantile(values, 0.75),
          quantile(values, 0.95)};
}

double finite_quantile(std::vector<double> values, double share) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  return quantile(values, share);
}

void draw_marks(Canvas& canvas, const Axes& axes) {
  const Plot& plot = axes.plot;
  canvas.clip(axes.box);
  for (const PlotBand& band : plot.bands) draw_band(canvas, axes, band);
  for (const PlotCurve& curve : plot.curves) draw_curve(canvas, axes, curve);
  for (const PlotBox& box : plot.boxes) draw_box(canvas, axes, box);
  canvas.unclip();
}

}  // namespace idol
