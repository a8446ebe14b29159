#include "idol/frontend/windower.hpp"

#include "test_util.hpp"

namespace idol {
namespace {

std::vector<Event> random_events(int count, unsigned seed) {
  std::mt19937 rng(seed);
  std::vector<Event> events;
  Time t = 1000;
  for (int i = 0; i < count; ++i) {
    t += std::uniform_int_distribution<Time>(0, 20000)(rng);
    if (i == count / 2) t += 350'000'000;  // the camera stands still
    events.push_back({t, static_cast<std::uint16_t>(rng() % 240), static_cast<std::uint16_t>(rng() % 180), rng() % 2 == 0});
  }
  return events;
}

std::vector<EventWindow> cut(const std::vector<Event>& events, std::size_t chunk, const WindowOptions& options) {
  Windower windower(options);
  std::vector<EventWindow> windows;
  for (std::size_t i = 0; i < events.size(); i += chunk) {
    windower.push(std::span(events).subspan(i, std::min(chunk, events.size() - i)));
    while (auto w = windower.pop()) windows.push_back(std::move(*w));
  }
  if (auto w = windower.flush()) windows.push_back(std::move(*w));
  return windows;
}

TEST(Windower, TilesTimeAndKeepsEveryEventOnce) {
  WindowOptions options;
  options.max_events = 500;
  options.max_duration_s = 0.05;
  const auto events = random_events(5000, 1);
  const auto windows = cut(events, 64, options);
  std::vector<Event> seen;
  for (std::size_t k = 0; k < windows.size(); ++k) {
    const auto& w = windows[k];
    if (k > 0) {
      EXPECT_EQ(w.begin, windows[k - 1].end);
      for (std::size_t i = 0; i < w.overlap; ++i)
        EXPECT_EQ(w.events[i], windows[k - 1].events[windows[k - 1].events.size() - w.overlap + i]);
    }
    EXPECT_LE(seconds_between(w.begin, w.end), options.max_duration_s + 1e-9);
    for (std::size_t i = w.overlap; i < w.events.size(); ++i) {
      EXPECT_GE(w.events[i].t, w.begin);
      EXPECT_LT(w.events[i].t, w.end);
      seen.push_back(w.events[i]);
    }
  }
  EXPECT_EQ(seen, events);
}

TEST(Windower, DoesNotDependOnPacketSize) {
  WindowOptions options;
  options.max_events = 333;
  const auto events = random_events(4000, 2);
  const auto reference = cut(events, events.size(), options);
  for (std::size_t chunk : {1UL, 7UL, 1000UL}) {
    const auto windows = cut(events, chunk, options);
    ASSERT_EQ(windows.size(), reference.size());
    for (std::size_t k = 0; k < windows.size(); ++k) {
      EXPECT_EQ(windows[k].begin, reference[k].begin);
      EXPECT_EQ(windows[k].end, reference[k].end);
      EXPECT_EQ(windows[k].events, reference[k].events);
    }
  }
}

TEST(Windower, EqualStampsStayTogetherAndNoEventsMakeNoWindow) {
  WindowOptions options;
  options.max_events = 100;
  EXPECT_TRUE(cut({}, 1, options).empty());
  const std::vector<Event> same(1000, Event{5, 1, 2, true});
  const auto windows = cut(same, 10, options);
  ASSERT_EQ(windows.size(), 1U);
  EXPECT_EQ(windows[0].events.size(), 1000U);
  EXPECT_EQ(windows[0].end, 6);
}

}  // namespace
}  // namespace idol
