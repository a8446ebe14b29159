#include "idol/odometry/rest_detector.hpp"

#include "test_util.hpp"

namespace idol::test {
namespace {

constexpr double kGravity = 9.81;

// A window of 50 ms with events and IMU readings.
bool feed(RestDetector& detector, int k, int events, const Vec3& gyro, std::size_t segments = 0) {
  EventWindow window;
  window.begin = from_seconds(0.05 * k);
  window.end = from_seconds(0.05 * (k + 1));
  window.events.resize(static_cast<std::size_t>(events));
  const std::vector<ImuSample> imu(10, {window.begin, Vec3(0, 0, kGravity), gyro});
  return detector.update(window, segments, imu, {Vec3(0.01, 0, 0), Vec3::Zero()}, kGravity);
}

TEST(RestDetector, AStillStartLastsUntilEventsRise) {
  RestDetector detector;
  detector.begin(true, from_seconds(0.5));
  int k = 0;
  for (; k < 10; ++k) EXPECT_TRUE(feed(detector, k, 100, {0.01, 0, 0}));
  for (; k < 20; ++k) EXPECT_TRUE(feed(detector, k, 110, {0.05, 0, 0}));  // the IMU alone does not end it
  EXPECT_FALSE(feed(detector, k, 300, {0.01, 0, 0}));
}

TEST(RestDetector, LinesOfSlowMotionEndARest) {
  RestDetector detector;
  detector.begin(true, from_seconds(0.5));
  EXPECT_TRUE(feed(detector, 0, 100, {0.01, 0, 0}));
  EXPECT_FALSE(feed(detector, 1, 100, {0.01, 0, 0}, 20));
  EXPECT_FALSE(feed(detector, 2, 100, {0.01, 0, 0}, 20));
}

TEST(RestDetector, ALaterRestNeedsBothForAWhile) {
  RestDetector detector;
  detector.begin(true, from_seconds(0.5));
  int k = 0;
  for (; k < 10; ++k) feed(detector, k, 100, {0.01, 0, 0});
  for (; k < 20; ++k) EXPECT_FALSE(feed(detector, k, 2000, {0.5, 0, 0}));
  for (; k < 40; ++k) EXPECT_FALSE(feed(detector, k, 0, {0.5, 0, 0})) << "darkness is no rest";
  for (; k < 60; ++k) EXPECT_FALSE(feed(detector, k, 2000, {0.01, 0, 0})) << "nor is gliding";
  EXPECT_FALSE(feed(detector, k++, 90, {0.01, 0, 0}));
  for (; k < 66; ++k) feed(detector, k, 90, {0.01, 0, 0});
  for (; k < 80; ++k) EXPECT_TRUE(feed(detector, k, 90, {0.01, 0, 0}));
  EXPECT_FALSE(feed(detector, k, 2000, {0.01, 0, 0}));
}

TEST(RestDetector, AMovingStartKnowsNoRestRate) {
  RestDetector detector;
  detector.begin(false, 0);
  int k = 0;
  for (; k < 20; ++k) EXPECT_FALSE(feed(detector, k, 500, {0.01, 0, 0}));
  for (; k < 40; ++k) feed(detector, k, 5, {0.01, 0, 0});
  EXPECT_TRUE(feed(detector, k, 5, {0.01, 0, 0}));
}

}  // namespace
}  // namespace idol::test
