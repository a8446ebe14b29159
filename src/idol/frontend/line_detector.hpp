// New lines from the events that no live line claims: support, local planes on the surface of last events,
// growth.
#pragma once

#include <Eigen/Core>
#include <array>
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

/// Moments of the points of a patch of 7x7 pixels, in one pass without neighbour lists: row by row, its
/// pixels side by side. Coordinates [px, px, px of time] from the patch's centre.
class PatchSums {
 public:
  static constexpr int kReach = 3;
  /// `stamps` [us]: of the row's middle pixel, with kReach more before and kReach + 1 after it; 0 = no event.
  /// Points older than `span` before `now` are left out; an age of 1 us counts as -`per_us` in time. Returns
  /// one bit a pixel that was used, the row's first pixel's the lowest.
  unsigned add_row(const std::uint32_t* stamps, std::uint32_t now, std::uint32_t span, float per_us, float y);
  [[nodiscard]] int count() const;
  /// nullopt for fewer than three points.
  [[nodiscard]] std::optional<PatchPlane> plane() const;

 private:
  static constexpr int kLanes = 4;
  using Lanes [[gnu::vector_size(kLanes * sizeof(float))]] = float;
  // Sums over the rows of four columns: number, y, y^2, z, z y, z^2.
  struct Columns {
    Lanes n{}, y{}, yy{}, z{}, yz{}, zz{};
  };
  std::array<Columns, 2> columns_;  // the last column is always zero
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
  /// Before each batch: how many events of it may be looked at closely. When the batch before had more, only
  /// every second (third, ...) one is.
  void begin_batch(double most);
  /// Events that were left out for this, by now.
  [[nodiscard]] std::int64_t skipped() const { return skipped_; }
  /// Fetches the memory that an event will need.
  void prefetch(const Event& event) const {
    const auto& stamps = stamps_[event.polarity ? 1 : 0];
    const std::size_t pixel = static_cast<std::size_t>(event.y) * width_ + event.x;
    __builtin_prefetch(&stamps[pixel]);
    __builtin_prefetch(&cells_[event.polarity ? 1 : 0][pixel]);
  }
  /// Takes an unclaimed event; a seed when it completes one. `c`: time that counts as a pixel [s/px].
  std::optional<LineSeed> add(const Event& event, double c, double min_length);

 private:
  // What the latest first-of-passage event of a pixel and polarity found.
  struct Cell {
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
  std::vector<std::uint32_t> stamps_[2];  // of the latest first-of-passage event [us]; 0 = none yet
  std::vector<Cell> cells_[2];
  std::vector<Cluster> pool_;
  std::uint32_t next_serial_ = 1;
  std::int64_t candidates_ = 0, stride_ = 1;  // of this batch; of how many candidates one is looked at
  std::int64_t skipped_ = 0;
};

}  // namespace idol
