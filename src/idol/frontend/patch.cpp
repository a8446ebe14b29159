#include "idol/frontend/patch.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

// The sums of four vectors' lanes, in the first four lanes of the last.
template <class V>
[[gnu::always_inline]] inline void sum_each(const V& a, const V& b, const V& c, const V& d, V& out) {
  constexpr IntLanes kEven{0, 8, 2, 10, 4, 12, 6, 14}, kOdd{1, 9, 3, 11, 5, 13, 7, 15};
  const V ab = __builtin_shuffle(a, b, kEven) + __builtin_shuffle(a, b, kOdd);
  const V cd = __builtin_shuffle(c, d, kEven) + __builtin_shuffle(c, d, kOdd);
  out = __builtin_shuffle(ab, cd, IntLanes{0, 1, 8, 9, 4, 5, 12, 13}) +
        __builtin_shuffle(ab, cd, IntLanes{2, 3, 10, 11, 6, 7, 14, 15});
  out += __builtin_shuffle(out, IntLanes{4, 5, 6, 7, 0, 1, 2, 3});
}

// One plane a lane. The least eigenvalue is by Laguerre's method on the characteristic polynomial, from 0 on:
// its roots are real, so no step passes the first, and two or three do. Its vector is any column of the
// adjugate of A - lambda I; the longest has the largest diagonal element.
struct PlaneLanes {
  using Values = std::array<double, kPlanesAtOnce>;
  Values n{}, x{}, y{}, xx{}, xy{}, yy{}, z{}, xz{}, yz{}, zz{};  // sums
  Values nx{}, ny{}, nz{}, planarity{};
};

IDOL_WIDE void fit_lanes(PlaneLanes& lanes) {
  constexpr int kSteps = 4;
  for (std::size_t k = 0; k < kPlanesAtOnce; ++k) {
    const double share = lanes.n[k] >= 3 ? 1 / lanes.n[k] : 0;
    const double x = share * lanes.x[k], y = share * lanes.y[k], z = share * lanes.z[k];
    double xx = share * lanes.xx[k] - x * x, yy = share * lanes.yy[k] - y * y,
           zz = share * lanes.zz[k] - z * z;
    const double xy = share * lanes.xy[k] - x * y, xz = share * lanes.xz[k] - x * z,
                 yz = share * lanes.yz[k] - y * z;
    const double trace = xx + yy + zz;
    const double minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    const double det = xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy);
    double least = 0;
    for (int step = 0; step < kSteps; ++step) {
      const double value = det - least * (minors - least * (trace - least));
      const double slope = minors - least * (2 * trace - 3 * least);
      const double inside = 4 * slope * slope - 6 * value * (2 * trace - 6 * least);
      const double below = slope + std::sqrt(inside > 0 ? inside : 0);
      least += below > 1e-12 * trace * trace ? 3 * value / below : 0;
    }
    const double sum = trace - least, product = minors - least * sum, apart = sum * sum / 4 - product;
    const double middle = sum / 2 - std::sqrt(apart > 0 ? apart : 0);
    xx -= least, yy -= least, zz -= least;
    const double a_xx = yy * zz - yz * yz, a_yy = xx * zz - xz * xz, a_zz = xx * yy - xy * xy;
    const double a_xy = xz * yz - xy * zz, a_xz = xy * yz - xz * yy, a_yz = xy * xz - xx * yz;
    const bool first = (a_xx >= a_yy) & (a_xx >= a_zz), second = a_yy >= a_zz;
    const double nx = first    ? a_xx
                      : second ? a_xy
                               : a_xz,
                 ny = first    ? a_xy
                      : second ? a_yy
                               : a_yz,
                 nz = first    ? a_xz
                      : second ? a_yz
                               : a_zz;
    const double squared = nx * nx + ny * ny + nz * nz;
    const bool flat = (squared > 0) & (middle > 0);  // else no plane, but a line or a point
    const double scale = flat ? 1 / std::sqrt(squared) : 0;
    lanes.nx[k] = nx * scale, lanes.ny[k] = ny * scale, lanes.nz[k] = nz * scale;
    lanes.planarity[k] = flat ? 1 - (least > 0 ? least : 0) / middle : 0;
  }
}

IDOL_WIDE void sum_patch(Patch& patch, const std::uint32_t* stamps, std::ptrdiff_t stride, std::uint32_t now,
                         std::uint32_t span, float per_us) {
  constexpr IntLanes kUsed{-1, -1, -1, -1, -1, -1, -1, 0};
  constexpr int kReach = Patch::kReach;
  static_assert(kReach == 3);
  IntLanes n{}, n1{}, n2{};  // number, sum of the sums up to each row, and of the sums of these
  FloatLanes z{}, yz{}, zz{};
  for (int row = 0; row < Patch::kSize; ++row) {
    IntLanes at;
    std::memcpy(&at, stamps + (row - kReach) * stride - kReach, kLaneBytes);
    // An age beyond the span may be anything, negative too.
    const IntLanes age = static_cast<std::int32_t>(now) - at;
    const IntLanes use = (age >= 0) & (age <= static_cast<std::int32_t>(span)) & (at != 0) & kUsed;
    const FloatLanes depth = __builtin_convertvector(age & use, FloatLanes) * -per_us;
    n -= use, n1 += n, n2 += n1;
    z += depth, yz += depth * static_cast<float>(row - kReach), zz += depth * depth;
    std::memcpy(&patch.used[static_cast<std::size_t>(row)], &use, kLaneBytes);
    std::memcpy(&patch.age[static_cast<std::size_t>(row)], &age, kLaneBytes);
  }
  // A row counts 4 - y times in n1, and (4 - y) (5 - y) / 2 times in n2.
  const IntLanes y = 4 * n - n1, yy = 16 * n - 9 * n1 + 2 * n2;
  constexpr IntLanes kX{-3, -2, -1, 0, 1, 2, 3, 0};
  const IntLanes x = kX * n;
  IntLanes few, products;
  FloatLanes depths;
  sum_each<IntLanes>(n, x, y, kX * x, few);
  sum_each<IntLanes>(kX * y, yy, IntLanes{}, IntLanes{}, products);
  sum_each<FloatLanes>(z, __builtin_convertvector(kX, FloatLanes) * z, yz, zz, depths);
  patch.sums = {few[0],      few[1],    few[2],    few[3],    products[0],
                products[1], depths[0], depths[1], depths[2], depths[3]};
}

IDOL_WIDE void mark_alike(const Patch& patch, const LocalEdges& edges, std::size_t pixel,
                          std::ptrdiff_t stride, const EdgeLimits& limits,
                          std::array<unsigned, 2 * kAlikeReach + 1>& out) {
  static_assert(kAlikeReach == 2 && Patch::kReach == 3);
  constexpr IntLanes kUsed{0, -1, -1, -1, -1, -1, 0, 0}, kBit{1, 2, 4, 8, 16, 32, 64, 128};
  constexpr FloatLanes kX{3, 2, 1, 0, -1, -2, -3, -4};  // of the middle, from each pixel
  const float nx = edges.nx[pixel], ny = edges.ny[pixel], speed = edges.speed[pixel];
  const auto load = [&](auto& lanes, const auto* from) { std::memcpy(&lanes, from, kLaneBytes); };
  for (int dy = -kAlikeReach; dy <= kAlikeReach; ++dy) {
    const auto row = static_cast<std::size_t>(dy + Patch::kReach);
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(pixel) + dy * stride - Patch::kReach;
    IntLanes use, age, cluster;
    FloatLanes other_nx, other_ny, other_speed;
    load(use, &patch.used[row]), load(age, &patch.age[row]), load(cluster, edges.cluster.data() + at);
    load(other_nx, edges.nx.data() + at), load(other_ny, edges.ny.data() + at);
    load(other_speed, edges.speed.data() + at);
    const auto y = static_cast<float>(-dy);
    const FloatLanes seconds = __builtin_convertvector(age & use, FloatLanes) * 1e-6F;
    const FloatLanes mine = nx * kX + ny * y - speed * seconds;
    const FloatLanes theirs = other_nx * kX + other_ny * y - other_speed * seconds;
    const IntLanes alike = use & kUsed & (cluster != 0) & (nx * other_nx + ny * other_ny >= limits.cosine) &
                           (mine <= limits.distance) & (mine >= -limits.distance) &
                           (theirs <= limits.distance) & (theirs >= -limits.distance);
    const IntLanes bits = alike & kBit;
    unsigned sum = 0;
    for (int k = 1; k <= 2 * kAlikeReach + 1; ++k) sum |= static_cast<unsigned>(bits[k]);
    out[static_cast<std::size_t>(dy + kAlikeReach)] = sum;
  }
}

}  // namespace

Patch::Patch(const std::uint32_t* stamps, std::ptrdiff_t stride, std::uint32_t now, std::uint32_t span,
             float per_us) {
  sum_patch(*this, stamps, stride, now, span, per_us);
}

void fit_planes(std::span<const Patch> patches, std::span<PatchPlane> planes) {
  for (std::size_t from = 0; from < patches.size(); from += kPlanesAtOnce) {
    const auto count = std::min<std::size_t>(kPlanesAtOnce, patches.size() - from);
    PlaneLanes lanes;
    for (std::size_t k = 0; k < count; ++k) {
      const Patch::Sums& sums = patches[from + k].sums;
      lanes.n[k] = sums.n, lanes.x[k] = sums.x, lanes.y[k] = sums.y, lanes.xx[k] = sums.xx,
      lanes.xy[k] = sums.xy, lanes.yy[k] = sums.yy, lanes.z[k] = sums.z, lanes.xz[k] = sums.xz,
      lanes.yz[k] = sums.yz, lanes.zz[k] = sums.zz;
    }
    fit_lanes(lanes);
    for (std::size_t k = 0; k < count; ++k)
      planes[from + k] = {Eigen::Vector3d(lanes.nx[k], lanes.ny[k], lanes.nz[k]).cast<float>(),
                          static_cast<float>(lanes.planarity[k])};
  }
}

std::array<unsigned, 2 * kAlikeReach + 1> edges_alike(const Patch& patch, const LocalEdges& edges,
                                                      std::size_t pixel, std::ptrdiff_t stride,
                                                      const EdgeLimits& limits) {
  std::array<unsigned, 2 * kAlikeReach + 1> out;
  mark_alike(patch, edges, pixel, stride, limits, out);
  return out;
}

}  // namespace idol
