#include "idol/frontend/line_detector.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <bit>
#include <cmath>

namespace idol {
namespace {

constexpr std::size_t kPool = 4096;  // clusters alive at once; the oldest give way
constexpr int kMinPatch = 7;         // events of a plane
constexpr float kMinPlanarity = 0.5F;
constexpr EdgeLimits kAlike{0.9F, 1};  // of neighbours in one line
constexpr int kBlock = 8;              // pieces of the image, in which events may be thinned [px]
constexpr int kPatience = 24;          // passages there of late, before only one of kFewer is looked at
constexpr int kFewer = 4;
constexpr double kFadeEvery = 0.2;      // [s]: a quarter of them is forgotten
constexpr int kMinCluster = 24;         // passages before a cluster is tested, and between tests
constexpr double kMaxThickness = 0.62;  // rms distance of a cluster's events from its moving line [px]

std::uint32_t to_us(Time t) { return static_cast<std::uint32_t>(t / 1000); }

}  // namespace

LineDetector::LineDetector(const UndistortMap& undistort)
    : undistort_(&undistort),
      width_(undistort.width()),
      height_(undistort.height()),
      edges_{LocalEdges(undistort.pixels()), LocalEdges(undistort.pixels())},
      block_cols_((width_ + kBlock - 1) / kBlock),
      block_rows_((height_ + kBlock - 1) / kBlock),
      blocks_(static_cast<std::size_t>(block_cols_ * block_rows_)),
      names_(kPool),
      pool_(kPool) {
  const std::size_t pixels = undistort.pixels();
  for (auto& stamps : stamps_) stamps.resize(pixels + 1);  // a row is read one pixel too far
}

LineDetector::Cluster* LineDetector::find(std::uint32_t serial) {
  while (serial != 0) {
    const Name& name = names_[serial % kPool];
    if (name.serial != serial) return nullptr;
    if (name.merged_into == 0) return &pool_[serial % kPool];
    serial = name.merged_into;
  }
  return nullptr;
}

LineDetector::Cluster& LineDetector::create(const Eigen::Vector2d& px, Time t) {
  Cluster& c = pool_[next_serial_ % kPool];
  c = {};
  names_[next_serial_ % kPool] = {next_serial_, 0};
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
  names_[from.serial % kPool].merged_into = into.serial;
}

void LineDetector::begin_batch(Time begin, double most, double c, double min_length) {
  c_ = c, min_length_ = min_length;
  if (begin >= next_fade_) {
    for (Block& block : blocks_) block.tried -= block.tried / 4;
    next_fade_ = begin + from_seconds(kFadeEvery);
  }
  seeds_.clear();
  stride_ = 1 + static_cast<std::int64_t>(static_cast<double>(candidates_) / std::max(1.0, most));
  candidates_ = 0;
}

void LineDetector::add(const Event& event) {
  if (!promising(event)) return;
  LocalEdges& edges = edges_[event.polarity ? 1 : 0];
  auto& stamps = stamps_[event.polarity ? 1 : 0];
  const std::uint32_t now = to_us(event.t);
  const std::size_t pixel = static_cast<std::size_t>(event.y) * width_ + event.x;
  const auto pixel_us = static_cast<std::uint32_t>(c_ * 1e6);
  if (stamps[pixel] != 0 && now - stamps[pixel] < 2 * pixel_us) return;  // later event of the same passage
  stamps[pixel] = now == 0 ? 1 : now;
  edges.cluster[pixel] = 0;
  constexpr int kReach = Patch::kReach;
  if (event.x < kReach || event.y < kReach || event.x >= width_ - kReach || event.y >= height_ - kReach)
    return;

  if (candidates_++ % stride_ != 0) {
    ++skipped_;
    return;
  }
  ++block_of(event).tried;
  Patch& patch = patches_[waiting_];
  patch = Patch(&stamps[pixel], width_, now, 5 * pixel_us, static_cast<float>(1e-6 / c_));
  if (patch.count() < kMinPatch) return;
  __builtin_prefetch(&(*undistort_)(event.x, event.y));
  events_[waiting_] = event;
  if (++waiting_ == kPlanesAtOnce) grow_waiting();
}

LineDetector::Block& LineDetector::block_of(const Event& event) {
  return blocks_[static_cast<std::size_t>(event.y / kBlock * block_cols_ + event.x / kBlock)];
}

// Curves and texture fire for ever, and no line comes of it: where much has been tried of late, only some
// events are looked at. A new line is found there a little later.
bool LineDetector::promising(const Event& event) {
  Block& block = block_of(event);
  return block.tried < kPatience || ++block.passed % kFewer == 0;
}

// Where a line is there may be more of it: about there, since its place is undistorted.
void LineDetector::encourage(const LineSeed& seed) {
  const Eigen::Vector2d dir(-seed.normal.y(), seed.normal.x());
  for (double u = -seed.length / 2; u <= seed.length / 2; u += 0.5 * kBlock) {
    const Eigen::Vector2d at = (seed.centre + u * dir) / kBlock;
    if (at.minCoeff() < 0 || at.x() >= block_cols_ || at.y() >= block_rows_) continue;
    blocks_[static_cast<std::size_t>(static_cast<int>(at.y()) * block_cols_ + static_cast<int>(at.x()))]
        .tried = 0;
  }
}

std::span<const LineSeed> LineDetector::end_batch() {
  grow_waiting();
  return seeds_;
}

void LineDetector::grow_waiting() {
  std::array<PatchPlane, kPlanesAtOnce> planes;
  fit_planes(std::span(patches_).first(waiting_), planes);
  for (std::size_t k = 0; k < waiting_; ++k)
    if (planes[k].planarity >= kMinPlanarity) grow(events_[k], patches_[k], planes[k].normal);
  waiting_ = 0;
}

void LineDetector::grow(const Event& event, const Patch& patch, Eigen::Vector3f n) {
  LocalEdges& edges = edges_[event.polarity ? 1 : 0];
  const std::size_t pixel = static_cast<std::size_t>(event.y) * width_ + event.x;
  constexpr int kReach = Patch::kReach;
  const float across = n.head<2>().norm();
  if (across < 0.15F || std::abs(n.z()) < 0.02F) return;
  if (n.z() > 0) n = -n;
  edges.nx[pixel] = n.x() / across;
  edges.ny[pixel] = n.y() / across;
  edges.speed[pixel] = -n.z() / across / static_cast<float>(c_);

  const Eigen::Vector2d px = (*undistort_)(event.x, event.y).cast<double>();
  Cluster* mine = nullptr;
  std::uint32_t same = 0;  // names it in most pixels around
  const std::uint32_t* row = &edges.cluster[pixel] - kAlikeReach * width_ - kReach;
  for (unsigned bits : edges_alike(patch, edges, pixel, width_, kAlike)) {
    for (; bits != 0; bits &= bits - 1) {
      const std::uint32_t other = row[std::countr_zero(bits)];
      if (other == same) continue;
      Cluster* theirs = find(other);
      if (!theirs) continue;
      same = other;
      if (theirs == mine) continue;
      if (!mine)
        mine = theirs;
      else if (mine->n >= theirs->n)
        merge(*mine, *theirs);
      else {
        merge(*theirs, *mine);
        mine = theirs;
      }
    }
    row += width_;
  }
  // What has travelled for long without becoming a line is none, or has changed its motion.
  if (mine && seconds_between(mine->t0, event.t) > 14 * c_) mine = nullptr;
  if (!mine) mine = &create(px, event.t);
  edges.cluster[pixel] = mine->serial;
  Eigen::Vector3d d;
  d << px - mine->origin, seconds_between(mine->t0, event.t);
  ++mine->n;
  mine->s += d;
  mine->m += d * d.transpose();
  if (mine->n < kMinCluster || mine->n < mine->tested + 8) return;
  mine->tested = mine->n;
  if (test(*mine, event.t)) encourage(seeds_.back());
}

bool LineDetector::test(Cluster& cluster, Time now) {
  const Eigen::Vector3d mean = cluster.s / cluster.n;
  Eigen::Matrix3d cov = cluster.m / cluster.n - mean * mean.transpose();
  const Eigen::Vector3d scale(1, 1, 1 / c_);
  cov = scale.asDiagonal() * cov * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(cov);
  Eigen::Vector3d n = eigen.eigenvectors().col(0);
  const double across = n.head<2>().norm();
  if (across < 0.15) return false;
  if (std::sqrt(std::max(0.0, eigen.eigenvalues()[0])) / across > kMaxThickness) return false;
  LineSeed seed;
  seed.normal = n.head<2>() / across;
  seed.speed = -n.z() / across / c_;
  const Eigen::Vector2d dir(-seed.normal.y(), seed.normal.x());
  seed.length = std::sqrt(12 * dir.dot(cov.topLeftCorner<2, 2>() * dir));
  if (seed.length < min_length_) return false;
  seed.centre = cluster.origin + mean.head<2>() +
                seed.normal * seed.speed * (seconds_between(cluster.t0, now) - mean.z());
  seed.time = now;
  seeds_.push_back(seed);
  names_[cluster.serial % kPool].serial = 0;  // done: its cells find nothing any more
  return true;
}

}  // namespace idol
