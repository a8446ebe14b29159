// What a small patch of pixels knows of an edge that crosses it, without lists of neighbours.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace idol {

/// Plane through events of a small patch: unit normal in (x, y, t/c), up to its sign, and 1 - smallest/middle
/// eigenvalue of their covariance. Both zero for fewer than three points, or points in a line.
struct PatchPlane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float planarity = 0;
};

/// The points of a patch of 7x7 pixels, one a pixel at most: its latest event. Coordinates [px, px, px of
/// time] from the patch's centre. Rows are taken eight pixels at a time, the last of which is not used.
class Patch {
 public:
  static constexpr int kReach = 3, kSize = 2 * kReach + 1, kLanes = 8;
  Patch() = default;
  /// `stamps` [us]: of the middle pixel, in rows of `stride`; 0 = no event. kReach more pixels each way are
  /// read, and one more at the end of a row. Points older than `span` before `now` are left out; an age of 1
  /// us counts as -`per_us` in time.
  Patch(const std::uint32_t* stamps, std::ptrdiff_t stride, std::uint32_t now, std::uint32_t span,
        float per_us);
  [[nodiscard]] int count() const { return sums.n; }

  // For each pixel: all bits where it has a point, and the point's age [us].
  std::array<std::array<std::int32_t, kLanes>, kSize> used, age;
  struct Sums {
    int n, x, y, xx, xy, yy;
    float z, xz, yz, zz;
  } sums;
};

/// The planes of as many patches; so many take hardly longer than one.
constexpr std::size_t kPlanesAtOnce = 8;
void fit_planes(std::span<const Patch> patches, std::span<PatchPlane> planes);

/// What each pixel's latest look at its patch found: normal along the motion, image speed along it [px/s],
/// and the cluster that its event belongs to (0 = none).
struct LocalEdges {
  explicit LocalEdges(std::size_t pixels)
      : nx(pixels + Patch::kLanes),
        ny(pixels + Patch::kLanes),
        speed(pixels + Patch::kLanes),
        cluster(pixels + Patch::kLanes) {}
  std::vector<float> nx, ny, speed;
  std::vector<std::uint32_t> cluster;
};

/// How far around a pixel its edge may go on [px].
constexpr int kAlikeReach = 2;

/// Limits for two edges that may be pieces of one line.
struct EdgeLimits {
  float cosine = 0;    ///< between their normals, at least
  float distance = 0;  ///< of each event from the other's moving line, at most [px]
};

/// Pixels up to kAlikeReach from the middle one with points of the patch that belong to clusters and whose
/// edges go on in the one found at `pixel`: a number a row, in it a bit each, the lowest that of dx =
/// -Patch::kReach.
std::array<unsigned, 2 * kAlikeReach + 1> edges_alike(const Patch& patch, const LocalEdges& edges,
                                                      std::size_t pixel, std::ptrdiff_t stride,
                                                      const EdgeLimits& limits);

}  // namespace idol
