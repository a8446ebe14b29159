#include "idol/odometry/rest_detector.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace idol {
namespace {

// A rest ends with more events than it has had: by this share, or, where noise is much and even, by so many
// standard deviations of its windows. It begins with half of that on top of the last one's, or where nearly
// all events are noise.
constexpr double kMoreThanRest = 0.35, kSigmas = 5, kMostlyNoise = 0.7;
constexpr int kRestWindows = 16;  // that tell what is usual at a rest
// For how long a rest is quiet before it is believed [s], and in the dark: with fewer events than this share
// of the last rest's, or than this [1/s].
constexpr double kQuietFirst = 0.3, kQuietInTheDark = 2, kDarkShare = 0.5, kDarkRate = 500;
// What the IMU may read beside its biases and gravity: meanwhile, and, as hands tremble, in a window.
constexpr double kQuietRate = 0.03, kTremorRate = 0.1;    // mean angular rate [rad/s]
constexpr double kQuietForce = 0.15, kTremorForce = 0.8;  // norm of the mean specific force [m/s^2]

bool near(const Eigen::Vector4d& readings, const Eigen::Vector4d& expected, double rate, double force) {
  const Eigen::Vector4d beside = readings - expected;
  return beside.head<3>().norm() < rate && std::abs(beside[3]) < force;
}

}  // namespace

void RestDetector::Usual::add(double events_per_s, const Eigen::Vector4d& imu_readings,
                              const Vec3& mean_force) {
  ++windows;
  const double before = events_per_s - events;
  events += before / windows;
  events_square += before * (events_per_s - events);
  imu += (imu_readings - imu) / windows;
  force += (mean_force - force) / windows;
}

void RestDetector::begin(bool still, Time known_until) {
  resting_ = still;
  known_until_ = known_until;
}

bool RestDetector::update(const EventWindow& window, bool image_moves, std::int64_t noise,
                          std::span<const ImuSample> imu, const ImuBias& bias, double gravity) {
  const double duration = seconds_between(window.begin, window.end);
  const auto count = static_cast<double>(window.events.size() - window.overlap);
  const double events = count / duration;
  Vec3 rate = Vec3::Zero(), force = Vec3::Zero();
  for (const auto& s : imu) {
    rate += s.gyro / static_cast<double>(imu.size());
    force += s.accel / static_cast<double>(imu.size());
  }
  Eigen::Vector4d readings, expected = rest_.imu;
  readings << rate, force.norm();
  if (rest_.windows == 0) expected << bias.gyro, gravity + force.norm() - (force - bias.accel).norm();

  if (resting_) {
    const bool moves = imu_moves(rate, force, duration) || image_moves;
    resting_ = !moves && (window.end <= known_until_ || events <= rest_.events + margin(duration));
    if (resting_ && rest_.windows < kRestWindows) rest_.add(events, readings, force);
    interrupted_ = !moves;
    if (!resting_) rate_beside_ = force_beside_ = Vec3::Zero();
    quiet_s_ = 0;
    return resting_;
  }
  const bool as_few = rest_.windows > 0 && events <= rest_.events + margin(duration) / 2;
  const bool quiet = !image_moves && (as_few || static_cast<double>(noise) >= kMostlyNoise * count) &&
                     !imu.empty() && near(readings, expected, kTremorRate, kTremorForce);
  // One window alone may be a jerk: the next one says.
  const bool goes_on = std::exchange(interrupted_, false) && as_few;
  if (!quiet) {
    quiet_s_ = 0;
    return false;
  }
  if (quiet_s_ == 0) quiet_ = {};
  quiet_s_ += duration;
  quiet_.add(events, readings, force);
  const bool dark = quiet_.events < std::max(kDarkShare * rest_.events, kDarkRate);
  if (quiet_s_ >= (dark ? kQuietInTheDark : kQuietFirst)) {
    resting_ = near(quiet_.imu, expected, kQuietRate, kQuietForce);
    if (resting_) rest_ = quiet_;
    quiet_s_ = 0;
  }
  resting_ = resting_ || goes_on;
  return resting_;
}

// Tremor goes to and fro within the time of the mean, motion goes on.
bool RestDetector::imu_moves(const Vec3& rate, const Vec3& force, double duration) {
  constexpr double kMeanOver = 0.2;  // [s]
  constexpr int kKnown = 6;          // windows that tell what the IMU reads at this rest
  if (rest_.windows < kKnown) {
    rate_beside_ = force_beside_ = Vec3::Zero();
    return false;
  }
  const double share = std::min(1.0, duration / kMeanOver);
  rate_beside_ += share * (rate - rest_.imu.head<3>() - rate_beside_);
  force_beside_ += share * (force - rest_.force - force_beside_);
  return rate_beside_.norm() > kQuietRate || force_beside_.norm() > kQuietForce;
}

// Of events per second, in a window of that many seconds.
double RestDetector::margin(double duration) const {
  // Noise comes event by event; tremor scatters more.
  const double variance = std::max(rest_.events / duration, rest_.events_square / std::max(1, rest_.windows));
  return std::min(kMoreThanRest * rest_.events, kSigmas * std::sqrt(variance));
}

}  // namespace idol
