#include "idol/frontend/line_detector.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace idol {
namespace {

constexpr std::size_t kPool = 4096;  // clusters alive at once; the oldest give way
constexpr int kGrowReach = 2;        // 5x5 for growth
constexpr int kMinPatch = 7;         // events of a plane
constexpr float kMinPlanarity = 0.5F;
constexpr float kMinCosine = 0.9F;      // between normals of one line
constexpr float kMaxDistance = 1.0F;    // of an event from its neighbour's moving line [px]
constexpr int kMinCluster = 24;         // passages before a cluster is tested, and between tests
constexpr double kMaxThickness = 0.62;  // rms distance of a cluster's events from its moving line [px]

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

std::uint32_t to_us(Time t) { return static_cast<std::uint32_t>(t / 1000); }

}  // namespace

unsigned PatchSums::add_row(const std::uint32_t* stamps, std::uint32_t now, std::uint32_t span, float per_us,
                            float y) {
  unsigned used = 0;
  using Ints [[gnu::vector_size(sizeof(Lanes))]] = std::int32_t;
  constexpr std::array<Ints, 2> kUsed{Ints{-1, -1, -1, -1}, Ints{-1, -1, -1, 0}};
  for (std::size_t half = 0; half < 2; ++half) {
    Columns& sums = columns_[half];
    Ints at;
    std::memcpy(&at, stamps - kReach + half * kLanes, sizeof(at));
    // An age beyond the span may be anything, negative too.
    const Ints age = static_cast<std::int32_t>(now) - at;
    const Ints use = (age >= 0) & (age <= static_cast<std::int32_t>(span)) & (at != 0) & kUsed[half];
    const Lanes one = -__builtin_convertvector(use, Lanes);
    const Lanes z = __builtin_convertvector(age & use, Lanes) * -per_us;
    sums.n += one, sums.y += one * y, sums.yy += one * (y * y);
    sums.z += z, sums.yz += z * y, sums.zz += z * z;
    const Ints bits = use & Ints{1, 2, 4, 8};
    used |= static_cast<unsigned>(bits[0] | bits[1] | bits[2] | bits[3]) << (half * kLanes);
  }
  return used;
}

int PatchSums::count() const {
  const Lanes n = columns_[0].n + columns_[1].n;
  return static_cast<int>(n[0] + n[1] + n[2] + n[3]);
}

std::optional<PatchPlane> PatchSums::plane() const {
  constexpr Lanes kLeft{-3, -2, -1, 0}, kRight{1, 2, 3, 4};
  static_assert(kReach == 3 && kLanes == 4);
  const auto& [l, r] = columns_;
  const auto sum = [](const Lanes& lanes) { return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]); };
  const float n = sum(l.n + r.n), y = sum(l.y + r.y), z = sum(l.z + r.z);
  const float x = sum(l.n * kLeft + r.n * kRight), xx = sum(l.n * kLeft * kLeft + r.n * kRight * kRight);
  const float xy = sum(l.y * kLeft + r.y * kRight), xz = sum(l.z * kLeft + r.z * kRight);
  const float yy = sum(l.yy + r.yy), yz = sum(l.yz + r.yz), zz = sum(l.zz + r.zz);
  if (n < 3) return std::nullopt;
  const Eigen::Vector3f mean = Eigen::Vector3f(x, y, z) / n;
  Eigen::Matrix3f covariance;
  covariance << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  return plane_of((covariance / n - mean * mean.transpose()).cast<double>());
}

LineDetector::LineDetector(const UndistortMap& undistort)
    : undistort_(&undistort), width_(undistort.width()), height_(undistort.height()), pool_(kPool) {
  const std::size_t pixels = static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  for (auto& cells : cells_) cells.resize(pixels);
  for (auto& stamps : stamps_) stamps.resize(pixels + 1);  // a row is read one pixel too far
}

LineDetector::Cluster* LineDetector::find(std::uint32_t serial) {
  while (serial != 0) {
    Cluster& c = pool_[serial % kPool];
    if (c.serial != serial) return nullptr;
    if (c.merged_into == 0) return &c;
    serial = c.merged_into;
  }
  return nullptr;
}

LineDetector::Cluster& LineDetector::create(const Eigen::Vector2d& px, Time t) {
  Cluster& c = pool_[next_serial_ % kPool];
  c = {};
  c.serial = next_serial_++;
  if (next_serial_ == 0) next_serial_ = 1;
  c.origin = px;
  c.t0 = t;
  return c;
}

void LineDetector::merge(Cluster& into, Cluster& from) {
  Eigen::Vector3d d;
  d << from.origin - into.origin, seconds_between(into.t0, from.t0);
  into.m += from.m + d * from.s.transpose() + from.s * d.transpose() + from.n * d * d.transpose();
  into.s += from.s + from.n * d;
  into.n += from.n;
  from.merged_into = into.serial;
}

void LineDetector::begin_batch(double most) {
  stride_ = 1 + static_cast<std::int64_t>(static_cast<double>(candidates_) / std::max(1.0, most));
  candidates_ = 0;
}

std::optional<LineSeed> LineDetector::add(const Event& event, double c, double min_length) {
  auto& cells = cells_[event.polarity ? 1 : 0];
  auto& stamps = stamps_[event.polarity ? 1 : 0];
  const std::uint32_t now = to_us(event.t);
  const std::size_t pixel = static_cast<std::size_t>(event.y) * width_ + event.x;
  Cell& own = cells[pixel];
  const auto pixel_us = static_cast<std::uint32_t>(c * 1e6);
  if (stamps[pixel] != 0 && now - stamps[pixel] < 2 * pixel_us)
    return std::nullopt;  // later event of the same passage
  stamps[pixel] = now == 0 ? 1 : now;
  own = {};
  constexpr int kReach = PatchSums::kReach;
  if (event.x < kReach || event.y < kReach || event.x >= width_ - kReach || event.y >= height_ - kReach)
    return std::nullopt;

  if (candidates_++ % stride_ != 0) {
    ++skipped_;
    return std::nullopt;
  }
  const std::uint32_t span = 5 * pixel_us;
  const auto per_us = static_cast<float>(1e-6 / c);
  PatchSums sums;
  std::array<unsigned, 2 * kReach + 1> used{};
  for (int dy = -kReach; dy <= kReach; ++dy)
    used[static_cast<std::size_t>(dy + kReach)] =
        sums.add_row(&stamps[pixel] + dy * width_, now, span, per_us, static_cast<float>(dy));
  if (sums.count() < kMinPatch) return std::nullopt;
  const auto plane = sums.plane();
  if (!plane || plane->planarity < kMinPlanarity) return std::nullopt;
  Eigen::Vector3f n = plane->normal;
  const float across = n.head<2>().norm();
  if (across < 0.15F || std::abs(n.z()) < 0.02F) return std::nullopt;
  if (n.z() > 0) n = -n;
  own.nx = n.x() / across;
  own.ny = n.y() / across;
  own.speed = -n.z() / across / static_cast<float>(c);

  const Eigen::Vector2d px = (*undistort_)(event.x, event.y).cast<double>();
  Cluster* mine = nullptr;
  for (int dy = -kGrowReach; dy <= kGrowReach; ++dy) {
    const Cell* row = &own + dy * width_;
    const std::uint32_t* row_stamps = &stamps[pixel] + dy * width_;
    constexpr unsigned kNear = ((1U << (2 * kGrowReach + 1)) - 1) << (kReach - kGrowReach);
    for (unsigned bits = used[static_cast<std::size_t>(dy + kReach)] & kNear; bits != 0; bits &= bits - 1) {
      const int dx = std::countr_zero(bits) - kReach;
      const Cell& other = row[dx];
      if (other.cluster == 0) continue;
      if (own.nx * other.nx + own.ny * other.ny < kMinCosine) continue;
      const float age = static_cast<float>(now - row_stamps[dx]) * 1e-6F;
      const auto x = static_cast<float>(-dx), y = static_cast<float>(-dy);
      if (std::abs(own.nx * x + own.ny * y - own.speed * age) > kMaxDistance ||
          std::abs(other.nx * x + other.ny * y - other.speed * age) > kMaxDistance)
        continue;
      Cluster* theirs = find(other.cluster);
      if (!theirs || theirs == mine) continue;
      if (!mine)
        mine = theirs;
      else if (mine->n >= theirs->n)
        merge(*mine, *theirs);
      else {
        merge(*theirs, *mine);
        mine = theirs;
      }
    }
  }
  // What has travelled for long without becoming a line is none, or has changed its motion.
  if (mine && seconds_between(mine->t0, event.t) > 14 * c) mine = nullptr;
  if (!mine) mine = &create(px, event.t);
  own.cluster = mine->serial;
  Eigen::Vector3d d;
  d << px - mine->origin, seconds_between(mine->t0, event.t);
  ++mine->n;
  mine->s += d;
  mine->m += d * d.transpose();
  if (mine->n < kMinCluster || mine->n < mine->tested + 8) return std::nullopt;
  mine->tested = mine->n;
  return test(*mine, event.t, c, min_length);
}

std::optional<LineSeed> LineDetector::test(Cluster& cluster, Time now, double c, double min_length) const {
  const Eigen::Vector3d mean = cluster.s / cluster.n;
  Eigen::Matrix3d cov = cluster.m / cluster.n - mean * mean.transpose();
  const Eigen::Vector3d scale(1, 1, 1 / c);
  cov = scale.asDiagonal() * cov * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(cov);
  Eigen::Vector3d n = eigen.eigenvectors().col(0);
  const double across = n.head<2>().norm();
  if (across < 0.15) return std::nullopt;
  if (std::sqrt(std::max(0.0, eigen.eigenvalues()[0])) / across > kMaxThickness) return std::nullopt;
  LineSeed seed;
  seed.normal = n.head<2>() / across;
  seed.speed = -n.z() / across / c;
  const Eigen::Vector2d dir(-seed.normal.y(), seed.normal.x());
  seed.length = std::sqrt(12 * dir.dot(cov.topLeftCorner<2, 2>() * dir));
  if (seed.length < min_length) return std::nullopt;
  seed.centre = cluster.origin + mean.head<2>() +
                seed.normal * seed.speed * (seconds_between(cluster.t0, now) - mean.z());
  cluster.serial = 0;  // done: its cells find nothing any more
  return seed;
}

}  // namespace idol
