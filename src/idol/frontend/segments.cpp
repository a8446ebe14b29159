#include "idol/frontend/segments.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include "idol/frontend/normals.hpp"
#include "idol/frontend/spacetime_grid.hpp"

namespace idol {
namespace {

// Bounds of the temporal scale: 1 ms/px (1000 px/s) to 25 ms/px (40 px/s); its value before anything is measured.
constexpr double kFastestScale = 0.001;
constexpr double kSlowestScale = 0.025;
constexpr double kFirstScale = 0.01;

std::vector<SpacetimePoint> to_points(const EventWindow& window, const UndistortMap& undistort, double c) {
  std::vector<SpacetimePoint> points(window.events.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Event& e = window.events[i];
    const Eigen::Vector2f& px = undistort(e.x, e.y);
    points[i] = {{px.x(), px.y(), static_cast<float>(seconds_between(window.begin, e.t) / c)}, e.x, e.y, e.polarity};
  }
  return points;
}

// Disjoint sets with the smallest member as representative: the result does not depend on the order of unions.
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

// Region growing: neighbours with |n_i.n_j| > n_thr, each within e_thr of the other's line (paper V). Returns the
// representative of each point's cluster.
std::vector<std::uint32_t> grow(std::span<const SpacetimePoint> points, const SpacetimeGrid& grid,
                                std::span<const LocalPlane> planes, const SegmentOptions& options) {
  UnionFind sets(points.size());
  const auto radius = static_cast<float>(options.radius_px);
  const auto n_thr = static_cast<float>(options.normal_threshold);
  const auto e_thr = static_cast<float>(options.distance_threshold_px);
  const int reach = static_cast<int>(std::ceil(radius));
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (!planes[i].valid()) continue;
    grid.for_each_neighbour(i, radius, reach, [&](std::uint32_t j) {
      if (j >= i || !planes[j].valid()) return;
      if (options.same_polarity && points[i].polarity != points[j].polarity) return;
      if (std::abs(planes[i].normal_xy.dot(planes[j].normal_xy)) < n_thr) return;
      const Eigen::Vector2f d = (points[j].x - points[i].x).head<2>();
      if (std::abs(planes[i].normal_xy.dot(d)) < e_thr && std::abs(planes[j].normal_xy.dot(d)) < e_thr) sets.unite(i, j);
    });
  }
  std::vector<std::uint32_t> root(points.size());
  for (std::uint32_t i = 0; i < root.size(); ++i) root[i] = sets.find(i);
  return root;
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
  if (speeds.empty()) return 0;
  std::nth_element(speeds.begin(), speeds.begin() + std::ssize(speeds) / 2, speeds.end());
  return speeds[speeds.size() / 2] / c;
}

}  // namespace

Segmenter::Segmenter(const SegmentOptions& options, const UndistortMap& undistort)
    : options_(options), undistort_(&undistort), c_(options.c_s_per_px > 0 ? options.c_s_per_px : kFirstScale) {}

SegmentedWindow Segmenter::process(const EventWindow& window) {
  const auto points = to_points(window, *undistort_, c_);
  const SpacetimeGrid grid(points, undistort_->width(), undistort_->height());
  const auto planes = estimate_normals(points, grid, static_cast<float>(options_.radius_px), options_.min_neighbours,
                                       static_cast<float>(options_.min_planarity), options_.same_polarity);
  const auto root = grow(points, grid, planes, options_);

  std::map<std::uint32_t, std::vector<std::uint32_t>> members;
  for (std::uint32_t i = 0; i < root.size(); ++i)
    if (planes[i].valid()) members[root[i]].push_back(i);
  std::vector<Cluster> clusters;
  for (auto& [first, events] : members) {
    if (std::ssize(events) < options_.min_events) continue;
    clusters.push_back({std::move(events), Eigen::Vector2d::UnitX()});
    clusters.back().normal = mean_normal(planes, clusters.back().events);
  }

  SegmentedWindow out;
  out.c_s_per_px = c_;
  out.speed_px_s = median_speed(planes, c_);
  out.segments = fit_segments(window, clusters);
  link(window, out.segments);
  out.ids.assign(window.events.size(), kNoLine);
  for (const auto& segment : out.segments)
    for (std::uint32_t i : segment.events) out.ids[i] = segment.id;
  overlap_ids_ = out.ids;
  adapt_scale(out.speed_px_s);
  return out;
}

std::vector<Segment> Segmenter::fit_segments(const EventWindow& window, const std::vector<Cluster>& clusters) const {
  std::vector<Segment> segments;
  std::vector<TimedPixel> events;
  for (const auto& cluster : clusters) {
    events.clear();
    for (std::uint32_t i : cluster.events) {
      const Event& e = window.events[i];
      const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
      events.emplace_back(px.x(), px.y(), seconds_between(window.begin, e.t));
    }
    const auto line = fit_moving_line(events, cluster.normal, options_.gate_px);
    if (!line || line->length_px() < options_.min_length_px || line->rms_px > options_.max_rms_px ||
        line->bow_px > options_.max_bow_px)
      continue;
    Segment segment;
    segment.line = *line;
    for (std::size_t k = 0; k < events.size(); ++k)
      if (std::abs(line->distance(events[k])) < options_.gate_px) segment.events.push_back(cluster.events[k]);
    if (std::ssize(segment.events) < options_.min_events ||
        static_cast<double>(segment.events.size()) < options_.min_inliers * static_cast<double>(events.size()))
      continue;
    segments.push_back(std::move(segment));
  }
  return segments;
}

// A segment takes the id that most of its repeated events had. Several may take the same: pieces of one line.
void Segmenter::link(const EventWindow& window, std::vector<Segment>& segments) {
  const std::size_t offset = overlap_ids_.size() - std::min(overlap_ids_.size(), window.overlap);
  std::map<LineId, const Segment*> largest;  // with each id
  std::stable_sort(segments.begin(), segments.end(),
            [](const Segment& a, const Segment& b) { return a.events.size() > b.events.size(); });
  for (auto& segment : segments) {
    std::map<LineId, int> votes;
    for (std::uint32_t i : segment.events)
      if (i < window.overlap && overlap_ids_[offset + i] != kNoLine) ++votes[overlap_ids_[offset + i]];
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
    if (segment.id == kNoLine) segment.id = next_id_++;
  }
}

// One pixel of motion should count like one pixel of distance: c = 1 / speed, followed slowly.
void Segmenter::adapt_scale(double speed_px_s) {
  if (options_.c_s_per_px > 0 || speed_px_s <= 0) return;
  const double wanted = std::clamp(1.0 / speed_px_s, kFastestScale, kSlowestScale);
  c_ = std::exp(0.5 * std::log(c_) + 0.5 * std::log(wanted));
}

}  // namespace idol
