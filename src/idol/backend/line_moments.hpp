// Many events of one line in a short time, compressed without loss: for a line l = (n, c), |n| = 1,
// sum_i (n.x_i + c)^2 = l^T S l with S = sum_i [x_i; 1][x_i; 1]^T. The centroid and the main axis of S give
// two points whose squared distances, times half the number of events, add up to the same, apart from the
// events' own scatter.
#pragma once

#include <span>

#include "idol/base/lie.hpp"

namespace idol {

/// Events of one line at (nearly) one time.
struct LineMoments {
  Vec2 centroid = Vec2::Zero();  ///< [px]
  Vec2 axis = Vec2::UnitX();     ///< unit, along the line
  double along_px = 0;           ///< standard deviation of the events along the axis
  double across_px = 0;          ///< and across it
  int count = 0;

  [[nodiscard]] Vec2 a() const { return centroid - along_px * axis; }
  [[nodiscard]] Vec2 b() const { return centroid + along_px * axis; }
};

/// Undistorted positions [px], already moved to one time.
LineMoments compress(std::span<const Vec2> points);

}  // namespace idol
