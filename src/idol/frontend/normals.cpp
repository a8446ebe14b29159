#include "idol/frontend/normals.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace idol {

std::vector<LocalPlane> estimate_normals(std::span<const SpacetimePoint> points, const SpacetimeGrid& grid,
                                         float radius, int min_neighbours, float min_planarity,
                                         bool same_polarity) {
  std::vector<LocalPlane> planes(points.size());
  const int reach = static_cast<int>(std::ceil(radius));
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const SpacetimePoint& p = points[i];
    int count = 0;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    Eigen::Matrix3f squares = Eigen::Matrix3f::Zero();
    grid.for_each_neighbour(i, radius, reach, [&](std::uint32_t j) {
      if (same_polarity && points[j].polarity != p.polarity) return;
      const Eigen::Vector3f d = points[j].x - p.x;  // relative to p: floats keep their digits
      ++count;
      sum += d;
      squares += d * d.transpose();
    });
    if (count < min_neighbours) continue;
    const float n = static_cast<float>(count);
    solver.computeDirect(squares / n - sum * sum.transpose() / (n * n));
    const Eigen::Vector3f eigenvalues = solver.eigenvalues();
    if (!(eigenvalues[1] > 1e-3f)) continue;  // all on one space-time line: no plane
    LocalPlane& plane = planes[i];
    plane.planarity = 1.0f - std::max(0.0f, eigenvalues[0]) / eigenvalues[1];
    plane.normal = solver.eigenvectors().col(0);
    const float length = plane.normal.head<2>().norm();
    if (plane.planarity >= min_planarity && length > 0.05f) plane.normal_xy = plane.normal.head<2>() / length;
  }
  return planes;
}

}  // namespace idol
