#include "idol/report/plot.hpp"

#include <algorithm>
#include <cmath>

#include "idol/report/plot_marks.hpp"

namespace idol {
namespace {

// Sizes in print [pt].
constexpr double kLabelSize = 8, kTickSize = 7, kLegendSize = 7;
constexpr double kTick = 2.5, kGap = 3;
constexpr double kLegendRow = 11, kLegendSample = 12;
constexpr double kBetween = 7;                                       // from a plot to the next
constexpr double kXTicks = kTick + kGap + kTickSize;                 // below a plot with numbers
constexpr double kXLabel = kGap + kLabelSize + 2;                    // and with a label
constexpr double kTypicalLeft = kLabelSize + kTick + 3 * kGap + 22;  // numbers of four or five letters
/// Share of a band that may lie outside: at first, before anything is known, it is wider than all curves.
constexpr double kBandOutside = 0.05;
constexpr Pen kFrame{{ink::kBlack}, 0.5};
constexpr Pen kGrid{{ink::kGrey, 0.3}, 0.3};

Span x_span(const Plot& plot) {
  Span span;
  if (plot.x_range.first != plot.x_range.second) return {plot.x_range.first, plot.x_range.second};
  for (const PlotBand& band : plot.bands) span.add(band.x);
  for (const PlotCurve& curve : plot.curves) span.add(curve.x);
  for (const PlotBox& box : plot.boxes) {
    span.add(box.x - box.width);
    span.add(box.x + box.width);
  }
  span.settle();
  if (plot.equal) span.pad(0.04);
  return span;
}

Span y_span(const Plot& plot) {
  Span span;
  if (plot.y_range.first != plot.y_range.second) return {plot.y_range.first, plot.y_range.second};
  for (const PlotBand& band : plot.bands) {
    span.add(finite_quantile(band.low, kBandOutside));
    span.add(finite_quantile(band.high, 1 - kBandOutside));
  }
  for (const PlotCurve& curve : plot.curves) span.add(curve.y);
  for (const PlotBox& box : plot.boxes) {
    if (box.values.empty()) continue;
    const BoxFigures f = box_figures(box.values);
    span.add(f.low);
    span.add(f.high);
  }
  if (plot.y_from_zero) span.add(0.0);
  span.settle();
  span.pad(0.05);
  if (plot.y_from_zero && span.low < 0) span.low = 0;
  return span;
}

/// What stands in a legend.
struct Entry {
  std::string name;
  const PlotCurve* curve;  // else a patch of
  Ink ink;

  bool operator==(const Entry& o) const { return name == o.name; }
};

std::vector<Entry> legend_of(const Plot& plot) {
  std::vector<Entry> entries;
  const auto add = [&](const Entry& entry) {
    if (!entry.name.empty() && std::find(entries.begin(), entries.end(), entry) == entries.end())
      entries.push_back(entry);
  };
  for (const PlotCurve& curve : plot.curves) add({curve.name, &curve, curve.pen.ink});
  for (const PlotBox& box : plot.boxes) add({box.name, nullptr, box.ink});
  for (const PlotBand& band : plot.bands) add({band.name, nullptr, band.ink});
  return entries;
}

void draw_grid(Canvas& canvas, const Axes& axes) {
  const Box& box = axes.box;
  if (axes.plot.plain) return;
  for (double v : axes.y_ticks.at) {
    const double y = axes.place(axes.x.low, v).y();
    canvas.line({box.left, y}, {box.right(), y}, kGrid);
  }
  if (!axes.plot.x_names.empty()) return;
  for (double v : axes.x_ticks.at) {
    const double x = axes.place(v, axes.y.low).x();
    canvas.line({x, box.top}, {x, box.bottom()}, kGrid);
  }
}

void draw_y_axis(Canvas& canvas, const Axes& axes, double label_left) {
  const Box& box = axes.box;
  for (double v : axes.y_ticks.at) {
    const double y = axes.place(axes.x.low, v).y();
    canvas.line({box.left, y}, {box.left - kTick, y}, kFrame);
    canvas.text({box.left - kTick - kGap, y}, axes.y_ticks.label(v), kTickSize, {1, 0.5});
  }
  // A label longer than its plot is high would run into the next one's.
  const double length = canvas.text_width(axes.plot.y_label, kLabelSize);
  const double size = kLabelSize * std::min(1.0, (box.height + kBetween) / length);
  canvas.text({label_left, box.top + 0.5 * box.height}, axes.plot.y_label, size, {0.5, 0}, true);
}

/// Ticks always; their numbers and the label unless the plot below has them.
void draw_x_axis(Canvas& canvas, const Axes& axes, bool numbers) {
  const Box& box = axes.box;
  const double below = box.bottom() + kTick + kGap;
  const auto tick = [&](double v, const std::string& name) {
    const double x = axes.place(v, axes.y.low).x();
    canvas.line({x, box.bottom()}, {x, box.bottom() + kTick}, kFrame);
    if (numbers) canvas.text({x, below}, name, kTickSize, {0.5, 0});
  };
  if (axes.plot.x_names.empty())
    for (double v : axes.x_ticks.at) tick(v, axes.x_ticks.label(v));
  for (const auto& [at, name] : axes.plot.x_names) tick(at, name);
  if (numbers)
    canvas.text({box.left + 0.5 * box.width, below + kTickSize + kGap}, axes.plot.x_label, kLabelSize,
                {0.5, 0});
}

/// Rows of a legend above a plot, and the height they take.
double draw_legend(Canvas& canvas, const std::vector<Entry>& entries, double left, double right, double top,
                   bool really) {
  if (entries.empty()) return 0;
  double x = left, y = top + 0.5 * kLegendRow;
  for (const Entry& entry : entries) {
    const double width = kLegendSample + kGap + canvas.text_width(entry.name, kLegendSize);
    if (x > left && x + width > right) {
      x = left;
      y += kLegendRow;
    }
    if (really) {
      const double end = x + kLegendSample;
      if (entry.curve == nullptr)
        canvas.polygon(std::vector<Vec2>{{x, y - 3}, {end, y - 3}, {end, y + 3}, {x, y + 3}}, entry.ink);
      else if (entry.curve->dot > 0)
        canvas.disc({x + 0.5 * kLegendSample, y}, entry.curve->dot, entry.ink);
      else
        canvas.line({x, y}, {end, y}, entry.curve->pen);
      canvas.text({end + kGap, y}, entry.name, kLegendSize, {0, 0.5});
    }
    x += width + 2.5 * kGap;
  }
  return y + 0.5 * kLegendRow - top;
}

/// A plot of a column.
struct Row {
  Axes axes;
  std::vector<Entry> legend;  ///< empty if it is that of the plot above
  bool shows_x;
  double below;  ///< room for the x axis and to the next plot [pt]
  double legend_height = 0;
};

std::vector<Row> lay_out(const std::vector<Plot>& plots) {
  Span common;  // of those that share the x axis
  const auto shares_x = [&](std::size_t i) { return plots[i].x_label == plots[0].x_label; };
  for (std::size_t i = 0; i < plots.size(); ++i) {
    if (!shares_x(i)) continue;
    const Span span = x_span(plots[i]);
    common.add(span.low);
    common.add(span.high);
  }
  std::vector<Row> rows;
  for (std::size_t i = 0; i < plots.size(); ++i) {
    const bool last = i + 1 == plots.size();
    const bool shows_x = last || plots[i + 1].x_label != plots[i].x_label;
    std::vector<Entry> legend = legend_of(plots[i]);
    if (i > 0 && legend == legend_of(plots[i - 1])) legend.clear();
    rows.push_back({{plots[i], {}, shares_x(i) ? common : x_span(plots[i]), y_span(plots[i]), {}, {}},
                    std::move(legend),
                    shows_x,
                    (shows_x ? kXTicks + kXLabel : 0) + (last ? 0 : kBetween)});
  }
  return rows;
}

/// Widens ranges that have room left, so that all scales agree: those of views one above the other, too.
void equalise(std::vector<Row>& rows) {
  double scale = std::numeric_limits<double>::infinity();
  for (const Row& row : rows) {
    const Axes& axes = row.axes;
    if (axes.plot.equal)
      scale = std::min({scale, axes.box.width / axes.x.length(), axes.box.height / axes.y.length()});
  }
  const auto widen = [scale](Span& span, double length) {
    const double middle = span.middle(), half = 0.5 * length / scale;
    span = {middle - half, middle + half};
  };
  for (Row& row : rows) {
    if (!row.axes.plot.equal) continue;
    widen(row.axes.x, row.axes.box.width);
    widen(row.axes.y, row.axes.box.height);
  }
}

void draw_row(Canvas& canvas, Row& row, double left) {
  Axes& axes = row.axes;
  draw_legend(canvas, row.legend, axes.box.left, axes.box.right(), axes.box.top - row.legend_height, true);
  axes.x_ticks = make_ticks(axes.x.low, axes.x.high, axes.box.width / 45);
  axes.y_ticks = make_ticks(axes.y.low, axes.y.high, std::clamp(axes.box.height / 22, 3.0, 8.0));
  draw_grid(canvas, axes);
  draw_marks(canvas, axes);
  canvas.rectangle(axes.box, kFrame);
  draw_y_axis(canvas, axes, left);
  draw_x_axis(canvas, axes, row.shows_x);
}

}  // namespace

double equal_height(const Plot& plot, double width, double most) {
  const double height = (width - kTypicalLeft) * y_span(plot).length() / x_span(plot).length();
  return std::clamp(height, 45.0, most) + kXTicks + kXLabel + kBetween;
}

void draw_column(Canvas& canvas, const Box& box, const std::vector<Plot>& plots) {
  std::vector<Row> rows = lay_out(plots);
  double numbers = 0;
  for (const Row& row : rows) {
    const Ticks ticks = make_ticks(row.axes.y.low, row.axes.y.high, 4);
    for (double v : ticks.at) numbers = std::max(numbers, canvas.text_width(ticks.label(v), kTickSize));
  }
  const double left = box.left + kLabelSize + 2 * kGap + numbers + kGap + kTick;
  const double right = box.right() - 5;
  double free = box.height - 4, shares = 0;
  for (Row& row : rows) {
    row.legend_height = draw_legend(canvas, row.legend, left, right, 0, false);
    free -= row.legend_height + row.below;
    shares += row.axes.plot.share;
  }
  double top = box.top + 2;
  for (Row& row : rows) {
    top += row.legend_height;
    row.axes.box = {left, top, right - left, free * row.axes.plot.share / shares};
    top = row.axes.box.bottom() + row.below;
  }
  equalise(rows);
  for (Row& row : rows) draw_row(canvas, row, box.left + 1);
}

}  // namespace idol
