#include <algorithm>
#include <map>
#include <set>

#include "idol/base/median.hpp"
#include "idol/frontend/moving_line.hpp"
#include "idol/frontend/normals.hpp"
#include "idol/frontend/segments.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

// An edge through `through` at `angle`, of half length `half`, moving along its normal.
struct Edge {
  Eigen::Vector2d through;
  double angle, half, speed_px_s;
  bool polarity = true;

  [[nodiscard]] Eigen::Vector2d direction() const { return {std::cos(angle), std::sin(angle)}; }
  [[nodiscard]] Eigen::Vector2d normal() const { return {-std::sin(angle), std::cos(angle)}; }
};

// Events of edges over [t0, t1): uniform along each edge and in time, positions rounded to pixels.
std::vector<Event> edge_events(const std::vector<Edge>& edges, double t0, double t1, double per_s,
                               unsigned seed, std::vector<int>* owner = nullptr) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> along(-1, 1), time(t0, t1);
  std::vector<std::pair<Event, int>> all;
  for (std::size_t k = 0; k < edges.size(); ++k) {
    const Edge& edge = edges[k];
    for (int i = 0; i < static_cast<int>(per_s * (t1 - t0)); ++i) {
      const double t = time(rng);
      const Eigen::Vector2d p =
          edge.through + along(rng) * edge.half * edge.direction() + edge.speed_px_s * t * edge.normal();
      if (p.x() < 0 || p.y() < 0 || p.x() > 239 || p.y() > 179) continue;
      all.push_back({{from_seconds(t), static_cast<std::uint16_t>(std::lround(p.x())),
                      static_cast<std::uint16_t>(std::lround(p.y())), edge.polarity},
                     static_cast<int>(k)});
    }
  }
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.first.t < b.first.t; });
  std::vector<Event> events;
  for (const auto& [event, k] : all) {
    events.push_back(event);
    if (owner != nullptr) owner->push_back(k);
  }
  return events;
}

std::vector<SpacetimePoint> points_of(const std::vector<Event>& events, double c) {
  std::vector<SpacetimePoint> points;
  for (const auto& e : events)
    points.push_back({{static_cast<float>(e.x), static_cast<float>(e.y),
                       static_cast<float>(static_cast<double>(e.t) / kNsPerS / c)},
                      e.x,
                      e.y,
                      e.polarity});
  return points;
}

const std::vector<Edge> kTwoEdges = {{{80, 60}, 0.3, 40, 150}, {{150, 120}, 1.4, 30, -100, false}};

TEST(SpacetimeGrid, FindsTheSameNeighboursAsBruteForce) {
  const auto points = points_of(edge_events(kTwoEdges, 0, 0.05, 20000, 1), 0.005);
  const SpacetimeGrid grid(points, 240, 180);
  for (std::uint32_t i = 0; i < points.size(); i += 17) {
    std::set<std::uint32_t> found, expected;
    grid.for_each_neighbour(i, 3.0F, 3, [&](std::uint32_t j) { found.insert(j); });
    for (std::uint32_t j = 0; j < points.size(); ++j)
      if ((points[j].x - points[i].x).norm() <= 3.0F) expected.insert(j);
    EXPECT_EQ(found, expected);
  }
  const SpacetimeGrid empty({}, 240, 180);
}

TEST(Normals, AreAcrossTheEdgeAndTellItsSpeed) {
  const Edge edge{{100, 80}, 0.5, 40, 200};
  const double c = 0.005;
  const auto points = points_of(edge_events({edge}, 0, 0.08, 60000, 2), c);
  const auto planes = estimate_normals(points, SpacetimeGrid(points, 240, 180), 4.0F, 8, 0.3F, true);
  std::vector<double> off, speed;
  for (const auto& plane : planes) {
    if (!plane.valid()) continue;
    off.push_back(std::abs(plane.normal_xy.cast<double>().dot(edge.direction())));
    speed.push_back(std::abs(plane.normal.z()) / plane.normal.head<2>().norm() / c);
  }
  ASSERT_GT(off.size(), points.size() / 2);
  EXPECT_LT(median(off), 0.1);
  EXPECT_NEAR(median(speed), 200, 30);
}

TEST(Normals, IdenticalPointsHaveNone) {
  const std::vector<Event> same(50, Event{1000, 10, 10, true});
  const auto points = points_of(same, 0.005);
  for (const auto& plane : estimate_normals(points, SpacetimeGrid(points, 240, 180), 3.0F, 4, 0.3F, true))
    EXPECT_FALSE(plane.valid());
}

TEST(MovingLine, FitsATurningAcceleratingLineAndTellsACurve) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<TimedPixel> line, circle;
  for (int i = 0; i < 800; ++i) {
    const double t = 0.05 * (1 + uniform(rng)), u = 40 * uniform(rng);
    const double angle = 0.7 + 2.0 * t;
    const Eigen::Vector2d n(-std::sin(angle), std::cos(angle));
    const Eigen::Vector2d p = Eigen::Vector2d(100, 80) +
                              u * Eigen::Vector2d(std::cos(angle), std::sin(angle)) +
                              (80 * t + 300 * t * t) * n + 0.3 * uniform(rng) * n;
    line.emplace_back(p.x(), p.y(), t);
    const double phi = 0.7 * uniform(rng);
    circle.emplace_back(100 + 30 * std::cos(phi) + 50 * t, 80 + 30 * std::sin(phi), t);
  }
  for (int i = 0; i < 40; ++i) line.emplace_back(100 + 60 * uniform(rng), 80 + 60 * uniform(rng), 0.05);
  const auto fit = fit_moving_line(line, Eigen::Vector2d(-std::sin(0.8), std::cos(0.8)), 2.0);
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->rms_px, 0.6);
  EXPECT_LT(fit->bow_px, 0.3);
  EXPECT_NEAR(fit->length_px(), 78, 5);
  const auto bent = fit_moving_line(circle, Eigen::Vector2d(1, 0), 4.0);
  ASSERT_TRUE(bent);
  EXPECT_GT(bent->bow_px, 3.0);
  EXPECT_FALSE(fit_moving_line({}, Eigen::Vector2d(1, 0), 2.0));
}

TEST(Segmenter, SeparatesEdgesAndKeepsTheirIdsOverWindows) {
  std::vector<int> owner;
  auto events = edge_events(kTwoEdges, 0, 0.3, 30000, 4, &owner);
  const UndistortMap flat(240, 180);
  WindowOptions cutting;
  cutting.max_duration_s = 0.05;
  Windower windower(cutting);
  SegmentOptions options;
  options.method = SegmentMethod::kPaper;
  const auto segmenter = make_segmenter(options, flat);
  windower.push(events);
  std::map<int, std::map<LineId, int>> votes;
  std::size_t k = 0, labelled = 0;
  const auto take = [&](const EventWindow& window) {
    const auto result = segmenter->process(window);
    ASSERT_EQ(result.ids.size(), window.events.size());
    for (std::size_t i = window.overlap; i < window.events.size(); ++i, ++k) {
      if (result.ids[i] == kNoLine) continue;
      ++votes[owner[k]][result.ids[i]];
      ++labelled;
    }
  };
  while (const auto window = windower.pop()) take(*window);
  take(*windower.flush());
  EXPECT_EQ(k, events.size());
  EXPECT_GT(labelled, events.size() * 8 / 10);
  ASSERT_EQ(votes.size(), 2U);
  for (const auto& [edge, ids] : votes) {
    int total = 0, best = 0;
    for (const auto& [id, count] : ids) {
      total += count;
      best = std::max(best, count);
    }
    EXPECT_GT(best, 0.9 * total) << "edge " << edge << " is cut into " << ids.size();
  }
  EXPECT_NE(votes[0].begin()->first, votes[1].begin()->first);
}

TEST(Segmenter, OddInputGivesNoSegments) {
  const UndistortMap flat(240, 180);
  SegmentOptions options;
  options.method = SegmentMethod::kPaper;
  const auto segmenter = make_segmenter(options, flat);
  EventWindow window;
  window.end = 100;
  EXPECT_TRUE(segmenter->process(window).segments.empty());
  window.events.assign(3000, Event{50, 7, 7, true});
  EXPECT_TRUE(segmenter->process(window).segments.empty());
  std::mt19937 rng(6);
  window.events.clear();
  for (int i = 0; i < 3000; ++i)
    window.events.push_back(
        {i * 10000, static_cast<std::uint16_t>(rng() % 240), static_cast<std::uint16_t>(rng() % 180), true});
  window.end = 30'000'000;
  EXPECT_TRUE(segmenter->process(window).segments.empty());
}

}  // namespace
}  // namespace idol
