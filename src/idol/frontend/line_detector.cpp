#include "idol/frontend/line_detector.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace idol {
namespace {

constexpr std::size_t kPool = 4096;  // clusters alive at once; the oldest give way
constexpr int kReach = 3;            // patch of 7x7 for planes
constexpr int kGrowReach = 2;        // 5x5 for growth
constexpr int kMinPatch = 7;         // events of a plane
constexpr float kMinPlanarity = 0.6F;
constexpr float kMinCosine = 0.9F;      // between normals of one line
constexpr float kMaxDistance = 1.0F;    // of an event from its neighbour's moving line [px]
constexpr int kMinCluster = 24;         // passages before a cluster is tested, and between tests
constexpr double kMaxThickness = 0.62;  // rms distance of a cluster's events from its moving line [px]

std::uint32_t to_us(Time t) { return static_cast<std::uint32_t>(t / 1000); }

}  // namespace

std::optional<PatchPlane> PatchSums::plane() const {
  if (n < 3) return std::nullopt;
  const float k = 1.0F / static_cast<float>(n);
  Eigen::Matrix3f cov;
  cov << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  cov = cov * k - (s * k) * (s * k).transpose();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> eigen;
  eigen.computeDirect(cov);
  PatchPlane out;
  out.normal = eigen.eigenvectors().col(0);
  out.planarity = 1 - std::max(0.0F, eigen.eigenvalues()[0]) / std::max(1e-9F, eigen.eigenvalues()[1]);
  return out;
}

LineDetector::LineDetector(const UndistortMap& undistort)
    : undistort_(&undistort), width_(undistort.width()), height_(undistort.height()), pool_(kPool) {
  for (auto& cells : cells_)
    cells.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
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

std::optional<LineSeed> LineDetector::add(const Event& event, double c, double min_length) {
  auto& cells = cells_[event.polarity ? 1 : 0];
  const std::uint32_t now = to_us(event.t);
  Cell& own = cells[static_cast<std::size_t>(event.y) * width_ + event.x];
  const auto pixel_us = static_cast<std::uint32_t>(c * 1e6);
  if (own.us != 0 && now - own.us < 2 * pixel_us) return std::nullopt;  // later event of the same passage
  own = {now == 0 ? 1 : now, 0, 0, 0, 0};
  if (event.x < kReach || event.y < kReach || event.x >= width_ - kReach || event.y >= height_ - kReach)
    return std::nullopt;

  const std::uint32_t span = 5 * pixel_us;
  const auto per_us = static_cast<float>(1e-6 / c);
  PatchSums sums;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    const Cell* row = &cells[static_cast<std::size_t>(event.y + dy) * width_ + event.x];
    for (int dx = -kReach; dx <= kReach; ++dx) {
      const std::uint32_t age = now - row[dx].us;
      if (age <= span && row[dx].us != 0)
        sums.add(static_cast<float>(dx), static_cast<float>(dy), -static_cast<float>(age) * per_us);
    }
  }
  if (sums.n < kMinPatch) return std::nullopt;
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
    const Cell* row = &cells[static_cast<std::size_t>(event.y + dy) * width_ + event.x];
    for (int dx = -kGrowReach; dx <= kGrowReach; ++dx) {
      const Cell& other = row[dx];
      if (other.cluster == 0 || now - other.us > span) continue;
      if (own.nx * other.nx + own.ny * other.ny < kMinCosine) continue;
      const float age = static_cast<float>(now - other.us) * 1e-6F;
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
