// Segment method `track`: synthetic moving edges, noise, and inputs that no camera should send.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <random>
#include <set>

#include "idol/frontend/segments.hpp"

namespace idol {
namespace {

SegmentOptions track_options() {
  SegmentOptions options;
  options.method = SegmentMethod::kTrack;
  return options;
}

std::vector<SegmentedWindow> run(const std::vector<Event>& events, int width, int height, std::size_t packet,
                                 std::vector<LineId>* ids = nullptr) {
  const UndistortMap undistort(width, height);
  Windower windower(WindowOptions{});
  const auto segmenter = make_segmenter(track_options(), undistort);
  std::vector<SegmentedWindow> out;
  const auto take = [&](const EventWindow& window) {
    out.push_back(segmenter->process(window));
    if (ids)
      ids->insert(ids->end(), out.back().ids.begin() + static_cast<std::ptrdiff_t>(window.overlap),
                  out.back().ids.end());
  };
  for (std::size_t i = 0; i < events.size(); i += packet) {
    windower.push({&events[i], std::min(packet, events.size() - i)});
    while (const auto window = windower.pop()) take(*window);
  }
  if (const auto window = windower.flush()) take(*window);
  return out;
}

void sort(std::vector<Event>& events) {
  std::sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
}

void add_noise(std::vector<Event>& events, double hz, double seconds, std::mt19937& rng) {
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < static_cast<int>(hz * 240 * 180 * seconds); ++i)
    events.push_back({from_seconds(unit(rng) * seconds), static_cast<std::uint16_t>(rng() % 240),
                      static_cast<std::uint16_t>(rng() % 180), rng() % 2 == 0});
  sort(events);
}

constexpr double kScatter = 0.4;  // of a real sensor's events across a sharp edge [px]

// A vertical edge 80 px long that moves to the right at `speed` px/s, and noise of `noise_hz` a pixel. Its
// events scatter by `scatter` px beside those of a perfect sensor, where each comes while the edge is in its
// pixel.
std::vector<Event> edge(double speed, double seconds, double noise_hz, double scatter = 0) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal(0, 1);
  std::vector<Event> events;
  for (int x = 30; x < 30 + static_cast<int>(speed * seconds); ++x)
    for (int y = 40; y < 120; ++y)
      for (int k = 0; k < 2; ++k)
        events.push_back({from_seconds((x - 30 + unit(rng) * 0.8) / speed),
                          static_cast<std::uint16_t>(x + std::lround(scatter * normal(rng))),
                          static_cast<std::uint16_t>(y), true});
  add_noise(events, noise_hz, seconds, rng);
  return events;
}

// Of all labels, the share of each id, the greatest first.
std::vector<double> shares(const std::vector<LineId>& ids) {
  std::map<LineId, double> n;
  double all = 0;
  for (const LineId id : ids)
    if (id != kNoLine) ++n[id], ++all;
  std::vector<double> out;
  for (const auto& [id, count] : n) out.push_back(count / all);
  std::sort(out.begin(), out.end(), std::greater<>());
  return out;
}

// Of the events near the edge of edge(200, ...), after the first 0.1 s.
double share_labelled_near(const std::vector<Event>& events, const std::vector<LineId>& ids) {
  double near = 0, labelled = 0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const double x = 30 + 200 * seconds_between(0, events[i].t);
    if (std::abs(events[i].x - x) > 1 || events[i].y < 45 || events[i].y > 115 || events[i].t < 100'000'000)
      continue;
    ++near;
    labelled += ids[i] != kNoLine ? 1 : 0;
  }
  return labelled / near;
}

void expect_long_line(const SegmentedWindow& window) {
  ASSERT_FALSE(window.segments.empty());
  const MovingLine& line = window.segments[0].line;
  EXPECT_GT(line.length_px(), 70);
  EXPECT_NEAR(std::abs(line.direction.y()), 1, 2e-3);
}

TEST(TrackSegments, OneEdgeIsOneLongTrack) {
  const auto events = edge(200, 0.8, 0);
  std::vector<LineId> ids;
  const auto windows = run(events, 240, 180, 1000, &ids);
  EXPECT_EQ(shares(ids).size(), 1U);
  EXPECT_GT(share_labelled_near(events, ids), 0.9);
  expect_long_line(windows[4]);
}

TEST(TrackSegments, OneEdgeIsOneLongTrackAlsoInNoise) {
  const auto events = edge(200, 0.8, 5, kScatter);
  std::vector<LineId> ids;
  const auto windows = run(events, 240, 180, 1000, &ids);
  ASSERT_FALSE(shares(ids).empty());
  EXPECT_GT(shares(ids)[0], 0.95);
  EXPECT_GT(share_labelled_near(events, ids), 0.9);
  expect_long_line(windows[4]);
}

// It comes to rest and goes back: between, noise makes more events than the edge.
std::vector<Event> edge_that_turns_back(double noise_hz, unsigned seed) {
  constexpr double kSeconds = 1.6;
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal(0, kScatter);
  std::vector<Event> events;
  int column = 60;
  for (double t = 0; t < kSeconds; t += 1e-4) {
    const double x = 60 + 70 * std::sin(std::numbers::pi * t / kSeconds);
    if (static_cast<int>(x) == column) continue;
    const bool right = static_cast<int>(x) > column;
    const double speed =
        std::max(5.0, 70 * std::numbers::pi / kSeconds * std::abs(std::cos(std::numbers::pi * t / kSeconds)));
    for (int y = 40; y < 120; ++y)
      for (int k = 0; k < 2; ++k)
        events.push_back(
            {from_seconds(t + 0.8 * unit(rng) / speed),
             static_cast<std::uint16_t>((right ? static_cast<int>(x) : column) + std::lround(normal(rng))),
             static_cast<std::uint16_t>(y), right});
    column = static_cast<int>(x);
  }
  add_noise(events, noise_hz, kSeconds, rng);
  return events;
}

// It stops within a pixel and goes on after a while: noise must not carry its track on.
std::vector<Event> edge_that_stops(double noise_hz, unsigned seed) {
  constexpr double kSpeed = 150, kRest = 0.15;
  auto events = edge(kSpeed, 0.8, 0, kScatter);
  for (Event& e : events)
    if (e.t > from_seconds(0.4)) e.t += from_seconds(kRest);
  std::mt19937 rng(seed);
  add_noise(events, noise_hz, 0.8 + kRest, rng);
  return events;
}

// Of all labels, those of the most frequent ids, so many of them.
double share_of_first(const std::vector<Event>& events, std::size_t count) {
  std::vector<LineId> ids;
  run(events, 240, 180, 1000, &ids);
  const auto of_ids = shares(ids);
  return std::accumulate(of_ids.begin(),
                         of_ids.begin() + static_cast<std::ptrdiff_t>(std::min(count, of_ids.size())), 0.0);
}

TEST(TrackSegments, AnEdgeThatTurnsBackIsOneTrack) {
  EXPECT_EQ(share_of_first(edge_that_turns_back(0, 5), 1), 1);
}

TEST(TrackSegments, AnEdgeThatTurnsBackInNoiseIsTwoTracksAtMost) {
  for (const unsigned seed : {3U, 5U, 7U, 9U})
    EXPECT_GT(share_of_first(edge_that_turns_back(5, seed), 2), 0.93) << "seed " << seed;
}

TEST(TrackSegments, AnEdgeThatStopsAtOnceInNoiseIsOneTrack) {
  for (const unsigned seed : {3U, 5U, 7U, 9U})
    EXPECT_GT(share_of_first(edge_that_stops(5, seed), 1), 0.95) << "seed " << seed;
}

TEST(TrackSegments, PacketSizeChangesNothing) {
  const auto events = edge(300, 0.5, 3);
  std::vector<LineId> one, many;
  run(events, 240, 180, 1, &one);
  run(events, 240, 180, events.size(), &many);
  EXPECT_EQ(one, many);
}

TEST(TrackSegments, OddInputsGiveNoLine) {
  const auto lines = [](const std::vector<Event>& events, int w, int h) {
    std::size_t n = 0;
    for (const auto& window : run(events, w, h, 500)) n += window.segments.size();
    return n;
  };
  EXPECT_EQ(lines({}, 240, 180), 0U);
  EXPECT_EQ(lines({{5, 239, 179, true}}, 240, 180), 0U);
  std::vector<Event> pixel, instant, jump;
  for (int i = 0; i < 50'000; ++i) {
    pixel.push_back({i * 2000, 100, 50, i % 2 == 0});
    instant.push_back(
        {7, static_cast<std::uint16_t>(i % 240), static_cast<std::uint16_t>(i / 240 % 180), true});
    jump.push_back({i < 25'000 ? i * 1000 : i * 1000 + 30'000'000'000,
                    static_cast<std::uint16_t>(i * 79 % 240), static_cast<std::uint16_t>(i * 31 % 180),
                    i % 3 == 0});
  }
  EXPECT_EQ(lines(pixel, 240, 180), 0U);
  EXPECT_EQ(lines(instant, 240, 180), 0U);
  lines(jump, 240, 180);
}

TEST(TrackSegments, AnySensorSize) {
  auto events = edge(200, 0.8, 0);
  for (Event& e : events) e.x += 1000, e.y += 580;
  std::size_t n = 0;
  for (const auto& window : run(events, 1280, 720, 777)) n += window.segments.size();
  EXPECT_GE(n, 4U);
}

// Events of a curve of points that moves to the right at 200 px/s; each pixel on it fires twice.
std::vector<Event> moving(const std::vector<Eigen::Vector2d>& points, double seconds) {
  constexpr double kSpeed = 200;
  std::mt19937 rng(5);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Event> events;
  std::vector<Time> last(240 * 180, -from_seconds(1));
  for (double t = 0; t < seconds; t += 0.2 / kSpeed)
    for (const auto& p : points) {
      const int x = static_cast<int>(std::lround(p.x() + kSpeed * t)),
                y = static_cast<int>(std::lround(p.y()));
      Time& before = last[static_cast<std::size_t>(y * 240 + x)];
      const Time now = from_seconds(t + 0.2 / kSpeed * unit(rng));
      if (seconds_between(before, now) < 2.5 / kSpeed) continue;
      before = now;
      for (int k = 0; k < 2; ++k)
        events.push_back(
            {now + k * 500'000, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), true});
    }
  std::sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
  return events;
}

double share_labelled(const std::vector<Event>& events) {
  std::vector<LineId> ids;
  run(events, 240, 180, 1000, &ids);
  return static_cast<double>(std::count_if(ids.begin(), ids.end(), [](LineId id) { return id != kNoLine; })) /
         static_cast<double>(ids.size());
}

TEST(TrackSegments, CirclesAreNoLines) {
  for (const double radius : {15.0, 25.0}) {
    std::vector<Eigen::Vector2d> circle, side;
    for (double a = 0; a < 2 * M_PI; a += 0.3 / radius)
      circle.emplace_back(50 + radius * std::cos(a), 90 + radius * std::sin(a));
    for (double y = 90 - radius; y < 90 + radius; y += 0.3) side.emplace_back(50, y);
    EXPECT_LT(share_labelled(moving(circle, 0.6)), 0.05) << radius;
    EXPECT_GT(share_labelled(moving(side, 0.6)), 0.6) << radius;  // the same way of making events, straight
  }
}

// A stone joint, say: near enough to a line for the estimator, no drawn line. Less than a wave of it may be
// straight.
TEST(TrackSegments, AWavyEdgeIsFollowedButItsEventsAreNotLabelled) {
  constexpr double kWave = 40;
  std::vector<Eigen::Vector2d> straight, wavy;
  for (double y = 50; y < 130; y += 0.3) {
    straight.emplace_back(50, y);
    wavy.emplace_back(50 + 0.6 * std::sin(2 * M_PI * y / kWave), y);
  }
  const auto found = [](const std::vector<Event>& events) {
    std::size_t n = 0, clear = 0;
    for (const SegmentedWindow& window : run(events, 240, 180, 1000))
      for (const Segment& s : window.segments)
        if (s.line.length_px() > 0.75 * kWave) n += 1, clear += s.straight ? 1 : 0;
    return std::pair(n, clear);
  };
  const auto [straight_n, straight_clear] = found(moving(straight, 0.6));
  EXPECT_GE(straight_n, 8U);
  EXPECT_EQ(straight_clear, straight_n);
  EXPECT_GT(share_labelled(moving(straight, 0.6)), 0.6);
  const auto [wavy_n, wavy_clear] = found(moving(wavy, 0.6));
  EXPECT_GE(wavy_n, 8U);
  EXPECT_EQ(wavy_clear, 0U);
  EXPECT_LT(share_labelled(moving(wavy, 0.6)), 0.3);
}

// An edge that turns back at once: what its events cannot tell soon enough, the gyro does.
TEST(TrackSegments, KnownTurnsAreFollowedAtOnce) {
  Camera camera;
  camera.width = 240, camera.height = 180;
  camera.fx = camera.fy = 200, camera.cx = 120, camera.cy = 90;
  constexpr double kRate = 2, kSpeed = 200 * kRate, kTurn = 0.2;  // [rad/s], [px/s] at the middle, [s]
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Event> events;
  for (double t = 0; t < 2 * kTurn; t += 1 / kSpeed) {
    const double x = 80 + kSpeed * (t < kTurn ? t : 2 * kTurn - t);
    for (int y = 60; y < 120; ++y)
      for (int k = 0; k < 2; ++k)
        events.push_back({from_seconds(t + 0.8 * unit(rng) / kSpeed),
                          static_cast<std::uint16_t>(std::lround(x)), static_cast<std::uint16_t>(y),
                          t < kTurn});
  }
  sort(events);
  std::vector<CameraRate> rates;
  for (double t = 0; t < 2 * kTurn; t += 0.001)
    rates.push_back({from_seconds(t), Vec3(0, t < kTurn ? -kRate : kRate, 0)});

  const UndistortMap undistort(camera);
  EXPECT_NEAR(undistort.rotational_flow({120, 90}, rates[0].omega).x(), kSpeed, 1e-9);
  const auto tracks = [&](std::span<const CameraRate> given) {
    const auto segmenter = make_segmenter(track_options(), undistort);
    Windower windower(WindowOptions{});
    windower.push(events);
    std::set<LineId> seen;
    const auto take = [&](const EventWindow& window) {
      for (const Segment& s : segmenter->process(window, given).segments) seen.insert(s.id);
    };
    while (const auto window = windower.pop()) take(*window);
    if (const auto window = windower.flush()) take(*window);
    return seen.size();
  };
  EXPECT_EQ(tracks(rates), 1U);
  EXPECT_GT(tracks({}), 1U);
}

TEST(TrackSegments, SaysWhatBecameOfTheEvents) {
  auto events = edge(200, 0.8, 5);
  for (int k = 0; k < 20'000; ++k) events.push_back({from_seconds(k * 4e-5), 200, 20, true});  // a hot pixel
  sort(events);
  const UndistortMap undistort(240, 180);
  auto options = track_options();
  options.track.detect_rate = 1e4;
  const auto segmenter = make_segmenter(options, undistort);
  Windower windower(WindowOptions{});
  windower.push(events);
  while (const auto window = windower.pop()) segmenter->process(*window);
  const SegmenterCounts counts = segmenter->counts();
  EXPECT_GT(counts.in_segments, 15'000);
  EXPECT_GT(counts.hot, 15'000);
  EXPECT_GT(counts.unsupported, 100'000);
  EXPECT_GT(counts.thinned, 100);
  EXPECT_LE(counts.in_segments + counts.hot + counts.unsupported + counts.thinned, counts.events);
}

}  // namespace
}  // namespace idol
