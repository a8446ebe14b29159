// Local planes of the event cloud (paper V): covariance of the neighbours, its least eigenvector.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "idol/frontend/spacetime_grid.hpp"

namespace idol {

struct LocalPlane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< unit, in (x, y, t/c)
  Eigen::Vector2f normal_xy =
      Eigen::Vector2f::Zero();  ///< its x-y part made unit; zero = no usable plane here
  float planarity = 0;          ///< 1 - smallest / middle eigenvalue, in [0, 1]
  [[nodiscard]] bool valid() const { return normal_xy != Eigen::Vector2f::Zero(); }
};

/// Plane through the neighbours of every point. Points with fewer than `min_neighbours` (itself included),
/// with planarity below `min_planarity`, or whose plane is one of constant time, get an invalid plane.
std::vector<LocalPlane> estimate_normals(std::span<const SpacetimePoint> points, const SpacetimeGrid& grid,
                                         float radius, int min_neighbours, float min_planarity,
                                         bool same_polarity);

}  // namespace idol
