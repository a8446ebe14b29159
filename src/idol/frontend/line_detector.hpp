// New lines from the events that no live line claims: support, local planes on the surface of last events,
// growth.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Plane through events of a small patch: unit normal in (x, y, t/c) and 1 - smallest/middle eigenvalue.
struct PatchPlane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float planarity = 0;
};

/// Sums over the points of a patch, one pass, no neighbour list. Coordinates relative to the centre event.
struct PatchSums {
  int n = 0;
  Eigen::Vector3f s = Eigen::Vector3f::Zero();
  float xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  void add(float x, float y, float z) {
    ++n;
    s += Eigen::Vector3f(x, y, z);
    xx += x * x, xy += x * y, xz += x * z, yy += y * y, yz += y * z, zz += z * z;
  }
  /// nullopt for fewer than three points.
  [[nodiscard]] std::optional<PatchPlane> plane() const;
};

/// A straight cluster found: where it is now and how it moves along its normal.
struct LineSeed {
  Eigen::Vector2d centre, normal;  ///< [px], unit
  double speed = 0;                ///< along the normal [px/s]
  double length = 0;               ///< [px]
};

class LineDetector {
 public:
  explicit LineDetector(const UndistortMap& undistort);
  /// Takes an unclaimed event; a seed when it completes one. `c`: time that counts as a pixel [s/px].
  std::optional<LineSeed> add(const Event& event, double c, double min_length);

 private:
  // Latest first-of-passage event of a pixel and polarity.
  struct Cell {
    std::uint32_t us = 0;
    std::uint32_t cluster = 0;        // serial; 0 = none
    float nx = 0, ny = 0, speed = 0;  // plane: normal along the motion, image speed along it [px/s]
  };
  // Moments of a cluster's points (x, y [px], t [s]) relative to its first.
  struct Cluster {
    std::uint32_t serial = 0, merged_into = 0;
    int n = 0, tested = 0;
    Time t0 = 0;
    Eigen::Vector2d origin = Eigen::Vector2d::Zero();
    Eigen::Vector3d s = Eigen::Vector3d::Zero();
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  };

  Cluster* find(std::uint32_t serial);
  Cluster& create(const Eigen::Vector2d& px, Time t);
  void merge(Cluster& into, Cluster& from);
  std::optional<LineSeed> test(Cluster& cluster, Time now, double c, double min_length) const;

  const UndistortMap* undistort_;
  int width_, height_;
  std::vector<Cell> cells_[2];
  std::vector<Cluster> pool_;
  std::uint32_t next_serial_ = 1;
};

}  // namespace idol
