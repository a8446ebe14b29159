#include "idol/frontend/cluster_segmenter.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "idol/base/median.hpp"
#include "idol/frontend/normals.hpp"
#include "idol/frontend/spacetime_grid.hpp"

namespace idol {
namespace {

// Bounds of the temporal scale: 1 ms/px (1000 px/s) to 25 ms/px (40 px/s); its value before anything is
// measured.
constexpr double kFastestScale = 0.001;
constexpr double kSlowestScale = 0.025;
constexpr double kFirstScale = 0.01;

std::vector<SpacetimePoint> to_points(const EventWindow& window, const UndistortMap& undistort, double c) {
  std::vector<SpacetimePoint> points(window.events.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Event& e = window.events[i];
    const Eigen::Vector2f& px = undistort(e.x, e.y);
    points[i] = {
        {px.x(), px.y(), static_cast<float>(seconds_between(window.begin, e.t) / c)}, e.x, e.y, e.polarity};
  }
  return points;
}

// Disjoint sets with the smallest member as representative: the result does not depend on the order of
// unions.
class UnionFind {
 public:
  explicit UnionFind(std::size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::uint32_t i, std::uint32_t j) {
    i = find(i);
    j = find(j);
    if (i != j) parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// Region growing among the points marked `active`: neighbours with |n_i.n_j| > n_thr, each within e_thr of
// the other's line (paper V). Clusters of at least min_events, by their first point; members in time order.
std::vector<std::vector<std::uint32_t>> grow(std::span<const SpacetimePoint> points,
                                             const SpacetimeGrid& grid, std::span<const LocalPlane> planes,
                                             const std::vector<bool>& active, double normal_threshold,
                                             const SegmentOptions& options) {
  UnionFind sets(points.size());
  const auto radius = static_cast<float>(options.radius_px);
  const auto n_thr = static_cast<float>(normal_threshold);
  const auto e_thr = static_cast<float>(options.distance_threshold_px);
  const int reach = static_cast<int>(std::ceil(radius));
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (!active[i]) continue;
    grid.for_each_neighbour(i, radius, reach, [&](std::uint32_t j) {
      if (j >= i || !active[j]) return;
      if (options.same_polarity && points[i].polarity != points[j].polarity) return;
      if (std::abs(planes[i].normal_xy.dot(planes[j].normal_xy)) < n_thr) return;
      const Eigen::Vector2f d = (points[j].x - points[i].x).head<2>();
      if (std::abs(planes[i].normal_xy.dot(d)) < e_thr && std::abs(planes[j].normal_xy.dot(d)) < e_thr)
        sets.unite(i, j);
    });
  }
  std::map<std::uint32_t, std::vector<std::uint32_t>> members;
  for (std::uint32_t i = 0; i < points.size(); ++i)
    if (active[i]) members[sets.find(i)].push_back(i);
  std::vector<std::vector<std::uint32_t>> clusters;
  for (auto& [first, cluster] : members)
    if (std::ssize(cluster) >= options.min_events) clusters.push_back(std::move(cluster));
  return clusters;
}

// Main direction of unsigned normals: the largest eigenvector of their scatter.
Eigen::Vector2d mean_normal(std::span<const LocalPlane> planes, std::span<const std::uint32_t> members) {
  Eigen::Matrix2d S = Eigen::Matrix2d::Zero();
  for (std::uint32_t i : members) {
    const Eigen::Vector2d n = planes[i].normal_xy.cast<double>();
    S += n * n.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(S).eigenvectors().col(1);
}

// Median image speed along the normals [px/s]; 0 where nothing has a normal.
double median_speed(std::span<const LocalPlane> planes, double c) {
  std::vector<float> speeds;
  for (const auto& plane : planes)
    if (plane.valid()) speeds.push_back(std::abs(plane.normal.z()) / plane.normal.head<2>().norm());
  return speeds.empty() ? 0 : median(std::move(speeds)) / c;
}

}  // namespace

ClusterSegmenter::ClusterSegmenter(const SegmentOptions& options, const UndistortMap& undistort)
    : options_(options),
      undistort_(&undistort),
      c_(options.c_s_per_px > 0 ? options.c_s_per_px : kFirstScale) {}

SegmentedWindow ClusterSegmenter::process(const EventWindow& window, std::span<const CameraRate> /*rates*/) {
  const auto points = to_points(window, *undistort_, c_);
  const SpacetimeGrid grid(points, undistort_->width(), undistort_->height());
  const auto planes =
      estimate_normals(points, grid, static_cast<float>(options_.radius_px), options_.min_neighbours,
                       static_cast<float>(options_.min_planarity), options_.same_polarity);
  SegmentedWindow out;
  out.c_s_per_px = c_;
  out.speed_px_s = median_speed(planes, c_);
  // What is not straight goes back to be grown with tighter normals: corners and curves come apart.
  std::vector<bool> active(points.size());
  for (std::size_t i = 0; i < active.size(); ++i) active[i] = planes[i].valid();
  double off = 1 - options_.normal_threshold;
  for (int round = 0; round <= options_.regrow_rounds; ++round, off /= 3) {
    const auto clusters = grow(points, grid, planes, active, 1 - off, options_);
    active.assign(points.size(), false);
    for (const auto& cluster : clusters) {
      if (auto segment = fit_segment(window, cluster, mean_normal(planes, cluster))) {
        out.segments.push_back(std::move(*segment));
      } else {
        for (std::uint32_t i : cluster) active[i] = true;
      }
    }
  }
  link(window, out.segments);
  out.ids.assign(window.events.size(), kNoLine);
  for (const auto& segment : out.segments)
    for (std::uint32_t i : segment.events) out.ids[i] = segment.id;
  counts_.add(window, out.ids);
  previous_ids_ = out.ids;
  adapt_scale(out.speed_px_s);
  return out;
}

std::optional<Segment> ClusterSegmenter::fit_segment(const EventWindow& window,
                                                     std::span<const std::uint32_t> cluster,
                                                     const Eigen::Vector2d& normal) const {
  std::vector<TimedPixel> events;
  for (std::uint32_t i : cluster) {
    const Event& e = window.events[i];
    const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
    events.emplace_back(px.x(), px.y(), seconds_between(window.begin, e.t));
  }
  const auto line = fit_moving_line(events, normal, options_.gate_px);
  if (!line || line->length_px() < options_.min_length_px || line->rms_px > options_.max_rms_px ||
      line->bow_px > options_.max_bow_px)
    return std::nullopt;
  Segment segment;
  segment.line = *line;
  for (std::size_t k = 0; k < events.size(); ++k)
    if (std::abs(line->distance(events[k])) < options_.gate_px) segment.events.push_back(cluster[k]);
  if (std::ssize(segment.events) < options_.min_events ||
      static_cast<double>(segment.events.size()) < options_.min_inliers * static_cast<double>(events.size()))
    return std::nullopt;
  return segment;
}

// A segment takes the id that most of its repeated events had. Several may take the same: pieces of one line.
void ClusterSegmenter::link(const EventWindow& window, std::vector<Segment>& segments) {
  const std::size_t offset = previous_ids_.size() - std::min(previous_ids_.size(), window.overlap);
  std::map<LineId, const Segment*> largest;  // with each id
  std::stable_sort(segments.begin(), segments.end(),
                   [](const Segment& a, const Segment& b) { return a.events.size() > b.events.size(); });
  for (auto& segment : segments) {
    std::map<LineId, int> votes;
    for (std::uint32_t i : segment.events)
      if (i < window.overlap && previous_ids_[offset + i] != kNoLine) ++votes[previous_ids_[offset + i]];
    const auto best = std::max_element(votes.begin(), votes.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    constexpr int kMinVotes = 5;
    if (best != votes.end() && best->second >= kMinVotes) {
      const auto [holder, first] = largest.try_emplace(best->first, &segment);
      const MovingLine& line = holder->second->line;
      const auto fits = [&](double u) {
        const Eigen::Vector2d end = segment.line.point(u, segment.line.time);
        return std::abs(line.distance({end.x(), end.y(), segment.line.time})) < options_.gate_px;
      };
      if (first || (fits(segment.line.u_min) && fits(segment.line.u_max))) segment.id = best->first;
    }
    if (segment.id == kNoLine) segment.id = recall(window, segment);
    if (segment.id == kNoLine) segment.id = next_id_++;
  }
  remember(window, segments);
}

// The nearest remembered line that, carried on at its last velocity, both ends of the segment would lie on.
LineId ClusterSegmenter::recall(const EventWindow& window, const Segment& segment) const {
  constexpr double kMaxGapPx = 15;  // along the line, between the two extents
  const double t = segment.line.time;
  const Eigen::Vector2d a = segment.line.point(segment.line.u_min, t),
                        b = segment.line.point(segment.line.u_max, t);
  LineId best = kNoLine;
  double nearest = options_.gate_px;
  for (const auto& [id, memory] : memory_) {
    const double there = t + seconds_between(memory.window_begin, window.begin);
    const Eigen::Vector3d ea(a.x(), a.y(), there), eb(b.x(), b.y(), there);
    const double ua = memory.line.along(ea), ub = memory.line.along(eb);
    const double gap = std::max(std::min(ua, ub) - memory.line.u_max, memory.line.u_min - std::max(ua, ub));
    const double off = std::max(std::abs(memory.line.distance(ea)), std::abs(memory.line.distance(eb)));
    if (gap > kMaxGapPx || off >= nearest) continue;
    nearest = off;
    best = id;
  }
  return best;
}

void ClusterSegmenter::remember(const EventWindow& window, const std::vector<Segment>& segments) {
  std::map<LineId, std::size_t> size;
  for (const auto& segment : segments) {
    // Of several pieces the largest stands for the line: segments come by decreasing size.
    if (!size.try_emplace(segment.id, segment.events.size()).second) continue;
    memory_[segment.id] = {segment.line.extrapolable(), window.begin, window.end};
  }
  std::erase_if(memory_, [&](const auto& entry) {
    return seconds_between(entry.second.last, window.end) > options_.memory_s;
  });
}

// One pixel of motion should count like one pixel of distance: c = 1 / speed, followed slowly.
void ClusterSegmenter::adapt_scale(double speed_px_s) {
  if (options_.c_s_per_px > 0 || speed_px_s <= 0) return;
  const double wanted = std::clamp(1.0 / speed_px_s, kFastestScale, kSlowestScale);
  c_ = std::exp(0.5 * std::log(c_) + 0.5 * std::log(wanted));
}

}  // namespace idol
