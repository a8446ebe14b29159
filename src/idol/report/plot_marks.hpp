// What is drawn inside the axes of a plot.
#pragma once

#include <limits>

#include "idol/report/plot.hpp"
#include "idol/report/ticks.hpp"

namespace idol {

/// From the lowest to the highest of what was added; nothing at first.
struct Span {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void add(double v) {
    if (!std::isfinite(v)) return;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  void add(const std::vector<double>& values) {
    for (double v : values) add(v);
  }
  [[nodiscard]] double length() const { return high - low; }
  [[nodiscard]] double middle() const { return 0.5 * (low + high); }
  void pad(double share) {
    const double by = share * length();
    low -= by;
    high += by;
  }
  /// Something to scale by, whatever there is.
  void settle() {
    if (!(low <= high)) *this = {0, 1};
    const double least = std::max(1e-9, 1e-6 * std::max(std::abs(low), std::abs(high)));
    if (length() < least)
      *this = {low - std::max(0.5 * std::abs(low), 1e-3), high + std::max(0.5 * std::abs(high), 1e-3)};
  }
};

struct BoxFigures {
  double low, first, median, third, high;
};

/// 5th, 25th, 50th, 75th and 95th percentile of at least one value, linear between samples.
BoxFigures box_figures(std::vector<double> values);

/// Of those that are finite; NaN if none is.
double finite_quantile(std::vector<double> values, double share);

/// One plot with its place on the page.
struct Axes {
  const Plot& plot;
  Box box;
  Span x, y;
  Ticks x_ticks, y_ticks;

  [[nodiscard]] Vec2 place(double px, double py) const {
    const double share = (py - y.low) / y.length();
    return {box.left + (px - x.low) / x.length() * box.width,
            box.top + (plot.y_down ? share : 1 - share) * box.height};
  }
};

/// Bands, then curves, then boxes, clipped to the axes.
void draw_marks(Canvas& canvas, const Axes& axes);

}  // namespace idol
