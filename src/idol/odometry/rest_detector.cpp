#include "idol/odometry/rest_detector.hpp"

#include <cmath>

namespace idol {
namespace {

constexpr double kMoreThanRest = 1.35;     // event rate that ends a rest, by its own rate
constexpr std::size_t kStraySegments = 2;  // that noise may form
constexpr double kQuietBeforeRest = 0.3;   // [s]
constexpr double kQuietRate = 0.03;        // [rad/s], mean angular rate of a window
constexpr double kQuietForce = 0.15;       // [m/s^2], mean specific force beside gravity's
constexpr double kDarkRate = 500;          // [1/s]: so few events are noise, where no rest has been seen yet

bool quiet(std::span<const ImuSample> imu, const ImuBias& bias, double gravity) {
  if (imu.empty()) return false;
  Vec3 rate = Vec3::Zero(), force = Vec3::Zero();
  for (const auto& s : imu) {
    rate += s.gyro / static_cast<double>(imu.size());
    force += s.accel / static_cast<double>(imu.size());
  }
  return (rate - bias.gyro).norm() < kQuietRate &&
         std::abs((force - bias.accel).norm() - gravity) < kQuietForce;
}

}  // namespace

void RestDetector::begin(bool still, Time known_until) {
  resting_ = still;
  known_until_ = known_until;
}

bool RestDetector::update(const EventWindow& window, std::size_t segments, std::span<const ImuSample> imu,
                          const ImuBias& bias, double gravity) {
  const double duration = seconds_between(window.begin, window.end);
  const double rate = static_cast<double>(window.events.size() - window.overlap) / duration;
  const bool shapeless = segments <= kStraySegments;
  if (resting_ && shapeless && window.end <= known_until_) {
    ++rest_windows_;
    rest_rate_ += (rate - rest_rate_) / rest_windows_;
    return true;
  }
  const bool few_events = shapeless && rate <= (rest_windows_ > 0 ? kMoreThanRest * rest_rate_ : kDarkRate);
  quiet_s_ = few_events && quiet(imu, bias, gravity) ? quiet_s_ + duration : 0;
  resting_ = few_events && (resting_ || quiet_s_ >= kQuietBeforeRest);
  return resting_;
}

}  // namespace idol
