// The paper's front-end (V) the plain way, to compare with: a kd-tree over a window's events in (x, y, t/c),
// radius searches, stored neighbour lists, covariance normals, region growing.
#pragma once

#include <Eigen/Eigenvalues>
#include <nanoflann.hpp>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/frontend/windower.hpp"

namespace idol::bench {

class ReferenceFrontend {
 public:
  ReferenceFrontend(const UndistortMap& undistort, float c_s_per_px)
      : undistort_(&undistort), c_(c_s_per_px) {}

  /// Number of clusters of at least 40 events.
  std::size_t process(const EventWindow& window) {
    points_.clear();
    for (const Event& e : window.events) {
      const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
      points_.emplace_back(px.x(), px.y(), static_cast<float>(seconds_between(window.begin, e.t)) / c_);
    }
    find_neighbours();
    find_normals();
    return grow();
  }

  // nanoflann's view of the points
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return points_.size(); }
  [[nodiscard]] float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points_[i][static_cast<Eigen::Index>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

 private:
  static constexpr float kRadius = 3, kMinCosine = 0.95F, kMaxDistance = 1;
  static constexpr std::size_t kMinNeighbours = 8, kMinCluster = 40;
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, ReferenceFrontend>,
                                                   ReferenceFrontend, 3>;

  void find_neighbours() {
    const Tree tree(3, *this, nanoflann::KDTreeSingleIndexAdaptorParams(10));
    neighbours_.resize(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      std::vector<std::pair<std::uint32_t, float>> found;
      tree.radiusSearch(points_[i].data(), kRadius * kRadius, found, nanoflann::SearchParams());
      neighbours_[i].clear();
      for (const auto& [j, distance] : found) neighbours_[i].push_back(j);
    }
  }

  void find_normals() {
    normals_.assign(points_.size(), Eigen::Vector2f::Zero());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const auto n = static_cast<float>(neighbours_[i].size());
      if (neighbours_[i].size() < kMinNeighbours) continue;
      Eigen::Vector3f mean = Eigen::Vector3f::Zero();
      for (const std::uint32_t j : neighbours_[i]) mean += points_[j] / n;
      Eigen::Matrix3f covariance = Eigen::Matrix3f::Zero();
      for (const std::uint32_t j : neighbours_[i])
        covariance += (points_[j] - mean) * (points_[j] - mean).transpose();
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> eigen(covariance);
      normals_[i] = eigen.eigenvectors().col(0).head<2>().normalized();
    }
  }

  std::size_t grow() {
    std::size_t clusters = 0;
    std::vector<bool> taken(points_.size());
    std::vector<std::uint32_t> queue;
    for (std::uint32_t seed = 0; seed < points_.size(); ++seed) {
      if (taken[seed] || normals_[seed].isZero()) continue;
      queue.assign(1, seed);
      taken[seed] = true;
      for (std::size_t next = 0; next < queue.size(); ++next) {
        const std::uint32_t i = queue[next];
        for (const std::uint32_t j : neighbours_[i]) {
          if (taken[j] || std::abs(normals_[i].dot(normals_[j])) < kMinCosine ||
              std::abs(normals_[i].dot((points_[j] - points_[i]).head<2>())) > kMaxDistance)
            continue;
          taken[j] = true;
          queue.push_back(j);
        }
      }
      clusters += queue.size() >= kMinCluster ? 1 : 0;
    }
    return clusters;
  }

  const UndistortMap* undistort_;
  float c_;
  std::vector<Eigen::Vector3f> points_;
  std::vector<std::vector<std::uint32_t>> neighbours_;
  std::vector<Eigen::Vector2f> normals_;
};

}  // namespace idol::bench
