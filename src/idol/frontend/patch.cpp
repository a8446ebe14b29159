#include "idol/frontend/patch.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

constexpr std::size_t kBytes = Patch::kLanes * sizeof(float);
using Ints [[gnu::vector_size(kBytes)]] = std::int32_t;
using Lanes [[gnu::vector_size(kBytes)]] = float;

// Least eigenvalue by Newton's method on the characteristic polynomial, from 0 on: it is convex up to there,
// so the steps never pass it. Its vector is across two rows of A - lambda I. Ten times the speed of a general
// solver.
PatchPlane plane_of(const Eigen::Matrix3d& A) {
  constexpr int kSteps = 12;
  const double trace = A.trace(), det = A.determinant();
  const double minors = A(0, 0) * A(1, 1) - A(0, 1) * A(0, 1) + A(0, 0) * A(2, 2) - A(0, 2) * A(0, 2) +
                        A(1, 1) * A(2, 2) - A(1, 2) * A(1, 2);
  double least = 0;
  for (int k = 0; k < kSteps; ++k) {
    const double value = det - least * (minors - least * (trace - least));
    const double slope = minors - least * (2 * trace - 3 * least);
    if (!(slope > 1e-12 * trace * trace)) break;
    const double step = value / slope;
    least += step;
    if (std::abs(step) < 1e-9 * trace) break;
  }
  const double sum = trace - least, product = minors - least * sum;
  const double middle = sum / 2 - std::sqrt(std::max(0.0, sum * sum / 4 - product));
  const Eigen::Matrix3d B = A - least * Eigen::Matrix3d::Identity();
  Eigen::Vector3d normal = B.row(0).cross(B.row(1));
  for (const auto& other : {B.row(1).cross(B.row(2)), B.row(2).cross(B.row(0))})
    if (other.squaredNorm() > normal.squaredNorm()) normal = other;
  PatchPlane out;
  const double length = normal.norm();
  if (!(length > 0) || !(middle > 0)) return out;  // no plane, but a line or a point
  out.normal = (normal / length).cast<float>();
  out.planarity = static_cast<float>(1 - std::max(0.0, least) / middle);
  return out;
}

IDOL_WIDE void sum_patch(Patch& patch, const std::uint32_t* stamps, std::ptrdiff_t stride, std::uint32_t now,
                         std::uint32_t span, float per_us) {
  constexpr Ints kUsed{-1, -1, -1, -1, -1, -1, -1, 0};
  constexpr int kReach = Patch::kReach;
  static_assert(kReach == 3);
  Ints n{}, n1{}, n2{};  // number, sum of the sums up to each row, and of the sums of these
  Lanes z{}, yz{}, zz{};
  for (int row = 0; row < Patch::kSize; ++row) {
    Ints at;
    std::memcpy(&at, stamps + (row - kReach) * stride - kReach, kBytes);
    // An age beyond the span may be anything, negative too.
    const Ints age = static_cast<std::int32_t>(now) - at;
    const Ints use = (age >= 0) & (age <= static_cast<std::int32_t>(span)) & (at != 0) & kUsed;
    const Lanes depth = __builtin_convertvector(age & use, Lanes) * -per_us;
    n -= use, n1 += n, n2 += n1;
    z += depth, yz += depth * static_cast<float>(row - kReach), zz += depth * depth;
    std::memcpy(&patch.used[static_cast<std::size_t>(row)], &use, kBytes);
    std::memcpy(&patch.age[static_cast<std::size_t>(row)], &age, kBytes);
  }
  // A row counts 4 - y times in n1, and (4 - y) (5 - y) / 2 times in n2.
  const Ints y = 4 * n - n1, yy = 16 * n - 9 * n1 + 2 * n2;
  std::memcpy(&patch.n, &n, kBytes), std::memcpy(&patch.y, &y, kBytes), std::memcpy(&patch.yy, &yy, kBytes);
  std::memcpy(&patch.z, &z, kBytes), std::memcpy(&patch.yz, &yz, kBytes), std::memcpy(&patch.zz, &zz, kBytes);
}

IDOL_WIDE void mark_alike(const Patch& patch, const LocalEdges& edges, std::size_t pixel,
                          std::ptrdiff_t stride, const EdgeLimits& limits,
                          std::array<unsigned, 2 * kAlikeReach + 1>& out) {
  static_assert(kAlikeReach == 2 && Patch::kReach == 3);
  constexpr Ints kUsed{0, -1, -1, -1, -1, -1, 0, 0}, kBit{1, 2, 4, 8, 16, 32, 64, 128};
  constexpr Lanes kX{3, 2, 1, 0, -1, -2, -3, -4};  // of the middle, from each pixel
  const float nx = edges.nx[pixel], ny = edges.ny[pixel], speed = edges.speed[pixel];
  const auto load = [&](auto& lanes, const auto* from) { std::memcpy(&lanes, from, kBytes); };
  for (int dy = -kAlikeReach; dy <= kAlikeReach; ++dy) {
    const auto row = static_cast<std::size_t>(dy + Patch::kReach);
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(pixel) + dy * stride - Patch::kReach;
    Ints use, age, cluster;
    Lanes other_nx, other_ny, other_speed;
    load(use, &patch.used[row]), load(age, &patch.age[row]), load(cluster, edges.cluster.data() + at);
    load(other_nx, edges.nx.data() + at), load(other_ny, edges.ny.data() + at);
    load(other_speed, edges.speed.data() + at);
    const auto y = static_cast<float>(-dy);
    const Lanes seconds = __builtin_convertvector(age & use, Lanes) * 1e-6F;
    const Lanes mine = nx * kX + ny * y - speed * seconds;
    const Lanes theirs = other_nx * kX + other_ny * y - other_speed * seconds;
    const Ints alike = use & kUsed & (cluster != 0) & (nx * other_nx + ny * other_ny >= limits.cosine) &
                       (mine <= limits.distance) & (mine >= -limits.distance) & (theirs <= limits.distance) &
                       (theirs >= -limits.distance);
    const Ints bits = alike & kBit;
    unsigned sum = 0;
    for (int k = 1; k <= 2 * kAlikeReach + 1; ++k) sum |= static_cast<unsigned>(bits[k]);
    out[static_cast<std::size_t>(dy + kAlikeReach)] = sum;
  }
}

}  // namespace

Patch::Patch(const std::uint32_t* stamps, std::ptrdiff_t stride, std::uint32_t now, std::uint32_t span,
             float per_us) {
  sum_patch(*this, stamps, stride, now, span, per_us);
  for (const int in_column : n) count_ += in_column;
}

std::optional<PatchPlane> Patch::plane() const {
  if (count_ < 3) return std::nullopt;
  int sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  float sz = 0, sxz = 0, syz = 0, szz = 0;
  for (int k = 0; k < kSize; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const int dx = k - kReach;
    sx += dx * n[at], sxx += dx * dx * n[at], sxy += dx * y[at], sy += y[at], syy += yy[at];
    sz += z[at], sxz += static_cast<float>(dx) * z[at], syz += yz[at], szz += zz[at];
  }
  const Eigen::Vector3d mean = Eigen::Vector3d(sx, sy, sz) / count_;
  Eigen::Matrix3d covariance;
  covariance << sxx, sxy, sxz, sxy, syy, syz, sxz, syz, szz;
  return plane_of(covariance / count_ - mean * mean.transpose());
}

std::array<unsigned, 2 * kAlikeReach + 1> edges_alike(const Patch& patch, const LocalEdges& edges,
                                                      std::size_t pixel, std::ptrdiff_t stride,
                                                      const EdgeLimits& limits) {
  std::array<unsigned, 2 * kAlikeReach + 1> out;
  mark_alike(patch, edges, pixel, stride, limits, out);
  return out;
}

}  // namespace idol
