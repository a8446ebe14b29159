#include "idol/odometry/image_motion.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace idol {

void ImageMotion::add(const EventWindow& window, const SegmentedWindow& segments) {
  constexpr double kMemory = 0.5;  // [s]
  newest_ = window.end;
  const double t = 0.5 * seconds_between(window.begin, window.end);
  for (const Segment& s : segments.segments) {
    const MovingLine& line = s.line;
    const double u = 0.5 * (line.u_min + line.u_max), slope = line.c[1] + line.c[3] * (t - line.time);
    const Eigen::Vector2d across(-line.direction.y(), line.direction.x());
    lines_[s.id].push_back({newest_, line.point(u, t), (across - slope * line.direction).normalized()});
  }
  for (auto& [id, seen] : lines_)
    while (!seen.empty() && seconds_between(seen.front().t, newest_) > kMemory) seen.pop_front();
  std::erase_if(lines_, [](const auto& entry) { return entry.second.empty(); });
}

bool ImageMotion::moves(double spread) const {
  constexpr double kMoved = 2;        // [px]: more than tremor and the fits' own errors
  constexpr std::size_t kFewest = 3;  // lines
  constexpr double kShare = 0.4;      // of the lines: those along the motion do not show it
  std::vector<double> x, y;
  std::size_t lines = 0;
  for (const auto& [id, seen] : lines_) {
    if (seen.back().t != newest_ || seen.size() < 2) continue;
    ++lines;
    const Seen &from = seen.front(), &to = seen.back();
    if (std::abs(from.normal.dot(to.middle - from.middle)) < kMoved) continue;
    x.push_back(to.middle.x()), y.push_back(to.middle.y());
  }
  if (x.size() < kFewest || static_cast<double>(x.size()) < kShare * static_cast<double>(lines)) return false;
  const auto range = [](std::vector<double>& values) {  // without the outermost tenths
    std::sort(values.begin(), values.end());
    const std::size_t cut = values.size() / 10;
    return values[values.size() - 1 - cut] - values[cut];
  };
  return range(x) >= spread * width_ && range(y) >= spread * height_;
}

}  // namespace idol
