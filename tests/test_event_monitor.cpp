#include "idol/io/event_monitor.hpp"

#include <gtest/gtest.h>

#include "idol/io/sensor_size.hpp"

namespace idol {
namespace {

/// Events all over the first `width` x `height` pixels, `step` nanoseconds apart.
std::vector<Event> spread(int count, int width, int height, Time step = 20'000) {
  std::vector<Event> events;
  for (int i = 0; i < count; ++i) {
    const auto pixel = static_cast<int>(i * 7919LL % (width * height));
    events.push_back({i * step, static_cast<std::uint16_t>(pixel % width),
                      static_cast<std::uint16_t>(pixel / width), i % 2 == 0});
  }
  return events;
}

EventMonitor watch(const std::vector<Event>& events, std::size_t piece = 1000) {
  EventMonitor monitor(240, 180);
  for (std::size_t i = 0; i < events.size(); i += piece)
    monitor.add({events.data() + i, std::min(piece, events.size() - i)});
  return monitor;
}

Camera davis(int width, int height) { return {width, height, 199, 199, 132, 110, Distortion::kNone, {}}; }

TEST(EventMonitor, NothingToSayOfGoodEventsOrNone) {
  Diagnostics diagnostics;
  EventMonitor(240, 180).report("x", diagnostics);
  watch(spread(200000, 240, 180)).report("x", diagnostics);
  EXPECT_TRUE(diagnostics.entries().empty());
}

TEST(EventMonitor, CountsSilencesAndHotPixelsHoweverTheEventsCome) {
  std::vector<Event> events = spread(300000, 240, 180);
  for (std::size_t i = 0; i < events.size(); i += 100) events[i].x = events[i].y = 77;
  for (std::size_t i = 150000; i < events.size(); ++i) events[i].t += 1'200'000'000;
  for (std::size_t i = 180000; i < events.size(); ++i) events[i].t += 1'000'000'000;
  for (const std::size_t piece : {1, 999, 300000}) {
    Diagnostics diagnostics;
    watch(events, piece).report("rec", diagnostics);
    ASSERT_EQ(diagnostics.entries().size(), 2U);
    EXPECT_EQ(diagnostics.entries().at("no_events").count, 2);
    EXPECT_EQ(
        diagnostics.entries().at("no_events").first_message.find("rec: no event for 1.200 s from 2.99998"),
        0U);
    EXPECT_EQ(diagnostics.entries().at("hot_pixels").count, 1);
    EXPECT_NE(diagnostics.entries().at("hot_pixels").first_message.find("(77, 77)"), std::string::npos);
  }
}

TEST(SensorFit, TellsAnotherSensorFromACutOut) {
  const EventMonitor whole = watch(spread(200000, 240, 180));
  EXPECT_EQ(sensor_fit(whole, davis(240, 180)), SensorFit::kGood);
  // The resolution alone is wrong: the principal point is far from its middle.
  EXPECT_EQ(sensor_fit(whole, davis(640, 480)), SensorFit::kOther);
  // All is of a larger sensor, whose principal point no event reaches.
  Camera large = davis(640, 480);
  large.cx = 320, large.cy = 240;
  EXPECT_EQ(sensor_fit(whole, large), SensorFit::kOther);
  // A small thing before the middle of the sensor, or in a band of it.
  EXPECT_EQ(sensor_fit(watch(spread(200000, 170, 130)), davis(240, 180)), SensorFit::kPartly);
  EXPECT_EQ(sensor_fit(watch(spread(200000, 240, 100)), davis(240, 180)), SensorFit::kPartly);
  EXPECT_EQ(sensor_fit(watch(spread(5000, 20, 20)), davis(240, 180)), SensorFit::kGood);
  Diagnostics diagnostics;
  EXPECT_THROW(check_sensor_fit("rec", whole, large, diagnostics), DataError);
  check_sensor_fit("rec", watch(spread(200000, 240, 100)), davis(240, 180), diagnostics);
  EXPECT_EQ(diagnostics.entries().at("part_of_sensor").count, 1);
}

TEST(SizeSeen, HoldsAllPixelsButAFewWildOnes) {
  SizeSeen seen;
  EXPECT_TRUE(seen.empty());
  seen.add(spread(20000, 346, 260));
  const std::vector<Event> wild = {{0, 60000, 3, true}, {0, 3, 41000, true}};
  seen.add(wild);
  EXPECT_EQ(seen.size("x").width, 346);
  EXPECT_EQ(seen.size("x").height, 260);
  // A rare pixel not far from the others is one of them.
  const std::vector<Event> rare = {{0, 600, 3, true}};
  seen.add(rare);
  EXPECT_EQ(seen.size("x").width, 601);
}

TEST(SizeSeen, RefusesWhatNoSensorIs) {
  SizeSeen seen;
  seen.add(spread(20000, 5000, 10));
  EXPECT_THROW((void)seen.size("x"), DataError);
  SizeSeen one;
  const std::vector<Event> single = {{0, 17, 4, true}};
  one.add(single);
  EXPECT_EQ(one.size("x").width, 18);
}

}  // namespace
}  // namespace idol
