// Segment method `track`: synthetic moving edges, noise, and inputs that no camera should send.
#include <gtest/gtest.h>

#include <cmath>
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

// A vertical edge 80 px long that moves to the right at `speed` px/s, and noise of `noise_hz` a pixel.
std::vector<Event> edge(double speed, double seconds, double noise_hz) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<Event> events;
  for (int x = 30; x < 30 + static_cast<int>(speed * seconds); ++x)
    for (int y = 40; y < 120; ++y)
      for (int k = 0; k < 2; ++k)
        events.push_back({from_seconds((x - 30 + unit(rng) * 0.8) / speed), static_cast<std::uint16_t>(x),
                          static_cast<std::uint16_t>(y), true});
  const auto noise = static_cast<int>(noise_hz * 240 * 180 * seconds);
  for (int i = 0; i < noise; ++i)
    events.push_back({from_seconds(unit(rng) * seconds), static_cast<std::uint16_t>(rng() % 240),
                      static_cast<std::uint16_t>(rng() % 180), rng() % 2 == 0});
  std::sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
  return events;
}

TEST(TrackSegments, OneEdgeIsOneLongTrackAlsoInNoise) {
  for (const double noise : {0.0, 5.0}) {
    const auto events = edge(200, 0.8, noise);
    std::vector<LineId> ids;
    const auto windows = run(events, 240, 180, 1000, &ids);
    std::set<LineId> seen;
    for (const LineId id : ids)
      if (id != kNoLine) seen.insert(id);
    EXPECT_EQ(seen.size(), 1U) << "noise " << noise;
    int near = 0, labelled = 0;
    for (std::size_t i = 0; i < events.size(); ++i) {
      const double x = 30 + 200 * seconds_between(0, events[i].t);
      if (std::abs(events[i].x - x) > 1 || events[i].y < 45 || events[i].y > 115 || events[i].t < 100'000'000)
        continue;
      ++near;
      labelled += ids[i] != kNoLine;
    }
    EXPECT_GT(labelled, 0.9 * near) << "noise " << noise;
    ASSERT_FALSE(windows[4].segments.empty());
    const MovingLine& line = windows[4].segments[0].line;
    EXPECT_GT(line.length_px(), 70);
    EXPECT_NEAR(std::abs(line.direction.y()), 1, 1e-3);
  }
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

}  // namespace
}  // namespace idol
