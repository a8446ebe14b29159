// Neighbours of an event in space-time (x, y, t/c), visited in place: no neighbour lists in memory.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// An event as a point: undistorted position [px] and scaled time t/c [px].
struct SpacetimePoint {
  Eigen::Vector3f x = Eigen::Vector3f::Zero();
  std::uint16_t col = 0;  ///< raw pixel: the cell it lives in
  std::uint16_t row = 0;
  bool polarity = false;
};

/// Points of one window bucketed by raw pixel; each bucket is in time order.
class SpacetimeGrid {
 public:
  /// `points` must be in time order, with raw pixels inside width x height, and outlive the grid.
  SpacetimeGrid(std::span<const SpacetimePoint> points, int width, int height)
      : points_(points), width_(width), height_(height) {
    const std::size_t cells = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    first_.assign(cells + 1, 0);
    for (const auto& p : points) ++first_[cell(p.col, p.row) + 1];
    for (std::size_t c = 0; c < cells; ++c) first_[c + 1] += first_[c];
    order_.resize(points.size());
    std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
    for (std::uint32_t i = 0; i < points.size(); ++i) order_[next[cell(points[i].col, points[i].row)]++] = i;
  }

  /// Calls visit(j) for every point j (i included) whose space-time distance to point i is at most `radius`,
  /// looking at raw pixels at most `reach` away (distortion can make that differ from the distance by a
  /// fraction of a pixel).
  template <class Visit>
  void for_each_neighbour(std::uint32_t i, float radius, int reach, Visit&& visit) const {
    const SpacetimePoint& p = points_[i];
    const int x0 = std::max(0, p.col - reach), x1 = std::min(width_ - 1, p.col + reach);
    const int y0 = std::max(0, p.row - reach), y1 = std::min(height_ - 1, p.row + reach);
    const float t0 = p.x.z() - radius, t1 = p.x.z() + radius, r2 = radius * radius;
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const std::size_t c = cell(x, y);
        auto it = order_.begin() + first_[c];
        const auto end = order_.begin() + first_[c + 1];
        if (end - it > 16)
          it = std::lower_bound(it, end, t0, [&](std::uint32_t j, float t) { return points_[j].x.z() < t; });
        for (; it != end; ++it) {
          const SpacetimePoint& q = points_[*it];
          if (q.x.z() > t1) break;
          if ((q.x - p.x).squaredNorm() <= r2) visit(*it);
        }
      }
    }
  }

 private:
  [[nodiscard]] std::size_t cell(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }

  std::span<const SpacetimePoint> points_;
  int width_, height_;
  std::vector<std::uint32_t> first_;  // of each cell in order_, and the end
  std::vector<std::uint32_t> order_;
};

}  // namespace idol
