#include "idol/backend/line_moments.hpp"

#include <algorithm>
#include <cmath>

namespace idol {

LineMoments compress(std::span<const Vec2> points) {
  LineMoments out;
  out.count = static_cast<int>(points.size());
  if (points.empty()) return out;
  const double n = static_cast<double>(points.size());
  for (const Vec2& p : points) out.centroid += p / n;
  double xx = 0, xy = 0, yy = 0;
  for (const Vec2& p : points) {
    const Vec2 d = p - out.centroid;
    xx += d.x() * d.x() / n;
    xy += d.x() * d.y() / n;
    yy += d.y() * d.y() / n;
  }
  const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
  const double mean = 0.5 * (xx + yy), half = std::hypot(0.5 * (xx - yy), xy);
  out.axis = {std::cos(angle), std::sin(angle)};
  out.along_px = std::sqrt(mean + half);
  out.across_px = std::sqrt(std::max(0.0, mean - half));
  return out;
}

}  // namespace idol
