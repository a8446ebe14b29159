#include "idol/odometry/rest_detector.hpp"

#include <cmath>

#include "test_util.hpp"

namespace idol::test {
namespace {

constexpr double kGravity = 9.81;

// A window of 50 ms with events, a share of them noise, and IMU readings.
struct Fed {
  RestDetector detector;
  int k = 0;
  bool operator()(int events, const Vec3& gyro, bool image_moves = false, double noise = 0,
                  const Vec3& push = Vec3::Zero()) {
    EventWindow window;
    window.begin = from_seconds(0.05 * k);
    window.end = from_seconds(0.05 * ++k);
    window.events.resize(static_cast<std::size_t>(events));
    const std::vector<ImuSample> imu(10, {window.begin, Vec3(0, 0, kGravity) + push, gyro});
    return detector.update(window, image_moves, static_cast<std::int64_t>(noise * events), imu,
                           {Vec3(0.01, 0, 0), Vec3::Zero()}, kGravity);
  }
};

TEST(RestDetector, AStillStartLastsUntilEventsRise) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(feed(100, {0.01, 0, 0}));
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(feed(110, {0.01, 0, 0}));
  EXPECT_FALSE(feed(300, {0.01, 0, 0}));
}

// In front of a blank wall no event says that it is over.
TEST(RestDetector, WhatTheImuReadsForLongEndsIt) {
  for (const auto& [gyro, push] :
       {std::pair(Vec3(0.05, 0, 0), Vec3(0, 0, 0)), std::pair(Vec3(0.01, 0, 0), Vec3(0.25, 0, 0))}) {
    Fed feed;
    feed.detector.begin(true, from_seconds(0.5));
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(feed(100, {0.01, 0, 0}));
    EXPECT_TRUE(feed(100, gyro, false, 0, push)) << "too soon to tell from tremor";
    bool ended = false;
    for (int i = 0; i < 9; ++i) ended = !feed(100, gyro, false, 0, push) || ended;
    EXPECT_TRUE(ended);
  }
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(feed(100, {0.01, 0, 0}));
  feed(100, {0.15, 0, 0});
  for (int i = 0; i < 40; ++i) EXPECT_FALSE(feed(100, {0.15, 0, 0}));
}

TEST(RestDetector, ARestThatTheImuEndsStaysEnded) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  for (int i = 0; i < 20; ++i) feed(100, {0.01, 0, 0});
  for (int i = 0; i < 10; ++i) feed(100, {0.05, 0, 0});
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(100, {0.05, 0, 0})) << i;
}

TEST(RestDetector, TremorThatGoesToAndFroDoesNotEndIt) {
  for (const double hz : {5.0, 8.0, 12.0}) {
    Fed feed;
    feed.detector.begin(true, from_seconds(0.5));
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(feed(100, {0.01, 0, 0}));
    for (int i = 0; i < 60; ++i) {
      const double swing = std::sin(2 * M_PI * hz * 0.05 * i);
      EXPECT_TRUE(feed(110, {0.01 + 0.05 * swing, 0, 0}, false, 0, {0.25 * swing, 0, 0})) << hz << " Hz";
    }
  }
}

TEST(RestDetector, MuchNoiseDoesNotHideItsEnd) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  const auto noisy = [](int i) { return 11300 + 100 * (i % 3 - 1); };
  for (int i = 0; i < 30; ++i) EXPECT_TRUE(feed(noisy(i), {0.01, 0, 0}, false, 0.92));
  EXPECT_FALSE(feed(12100, {0.01, 0, 0}, false, 0.92));
}

TEST(RestDetector, OneJerkDoesNotEndIt) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  for (int i = 0; i < 10; ++i) feed(500 + 50 * (i % 2), {0.01, 0, 0});
  EXPECT_FALSE(feed(800, {0.01, 0, 0}));
  EXPECT_TRUE(feed(520, {0.01, 0, 0}));
  EXPECT_FALSE(feed(800, {0.01, 0, 0}));
  EXPECT_FALSE(feed(1100, {0.01, 0, 0}));
  EXPECT_FALSE(feed(520, {0.01, 0, 0}));
}

TEST(RestDetector, LinesOfSlowMotionEndARest) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  EXPECT_TRUE(feed(100, {0.01, 0, 0}));
  EXPECT_FALSE(feed(100, {0.01, 0, 0}, true));
  EXPECT_FALSE(feed(100, {0.01, 0, 0}, true));
}

TEST(RestDetector, ALaterRestNeedsBothForAWhile) {
  Fed feed;
  feed.detector.begin(true, from_seconds(0.5));
  for (int i = 0; i < 10; ++i) feed(100, {0.01, 0, 0});
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(feed(2000, {0.5, 0, 0}));
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(0, {0.5, 0, 0})) << "darkness is no rest";
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(0, {0.01, 0, 0})) << "nor so soon if the IMU is quiet";
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(2000, {0.01, 0, 0})) << "nor is gliding";
  EXPECT_FALSE(feed(90, {0.01, 0, 0}));
  for (int i = 0; i < 45; ++i) feed(90, {0.01, 0, 0});
  for (int i = 0; i < 14; ++i) EXPECT_TRUE(feed(90, {0.01, 0, 0}));
  EXPECT_FALSE(feed(2000, {0.01, 0, 0}));
}

TEST(RestDetector, RestAfterAMovingStart) {
  Fed feed;
  feed.detector.begin(false, 0);
  for (int i = 0; i < 20; ++i)
    EXPECT_FALSE(feed(500, {0.01, 0, 0}, false, 0.5)) << "moves: few events are noise";
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(500, {0.06, 0, 0}, false, 0.9)) << "turns";
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(feed(500, {0.01, 0, 0}, false, 0.9, {0, 0, 0.3})) << "speeds up";
  // A hand trembles.
  const auto trembling = [&](int i) {
    return feed(500, {0.01, 0.04 * (i % 2), 0}, false, 0.9, {0, 0, i % 2 ? 0.3 : -0.3});
  };
  for (int i = 0; i < 8; ++i) trembling(i);
  for (int i = 8; i < 40; ++i) EXPECT_TRUE(trembling(i)) << i;
  EXPECT_FALSE(feed(900, {0.01, 0, 0}, false, 0.5));
}

TEST(RestDetector, RestOfASensorWithoutNoise) {
  Fed feed;
  feed.detector.begin(false, 0);
  for (int i = 0; i < 39; ++i) EXPECT_FALSE(feed(0, {0.01, 0, 0}));
  feed(0, {0.01, 0, 0}), feed(0, {0.01, 0, 0});
  EXPECT_TRUE(feed(0, {0.01, 0, 0}));
  EXPECT_FALSE(feed(50, {0.01, 0, 0}));
}

}  // namespace
}  // namespace idol::test
