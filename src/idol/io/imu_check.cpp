#include "idol/io/imu_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/signed_axes.hpp"

namespace idol {
namespace {

constexpr std::array<const char*, 6> kNames = {"acceleration x", "acceleration y", "acceleration z",
                                               "rate x",         "rate y",         "rate z"};
constexpr std::int64_t kEnough = 100;  // samples
constexpr Time kMean = 100'000'000, kLongestFrozen = 500'000'000;
constexpr std::size_t kMostMeans = 6000;  // ten minutes

/// How well rates that are turned and mirrored by `axes` explain how the acceleration's direction moves:
/// gravity stands still in the world, so it turns against the sensor.
struct Fit {
  double match = 0, scale = 0;  // correlation; factor that the rates want
};

}  // namespace

void ImuCheck::Channel::add(double v, bool first) {
  run = !first && v == value ? run + 1 : 1;
  value = v;
  constexpr std::int64_t kRun = 3;
  const std::int64_t repeats = run == kRun ? kRun : run > kRun ? 1 : 0;
  if (first || v < least) {
    least = v;
    at_least = 0;
  }
  if (first || v > most) {
    most = v;
    at_most = 0;
  }
  if (v == least) at_least += repeats;
  if (v == most) at_most += repeats;
}

void ImuCheck::add(const ImuSample& sample) {
  const bool first = count_ == 0;
  if (first) first_ = same_since_ = sample.t;
  for (std::size_t i = 0; i < kChannels; ++i) {
    const auto axis = static_cast<Eigen::Index>(i % 3);
    channels_[i].add(i < 3 ? sample.accel[axis] : sample.gyro[axis], first);
  }
  if (!first && (sample.accel != last_.accel || sample.gyro != last_.gyro)) same_since_ = sample.t;
  if (sample.t - same_since_ > frozen_for_) {
    frozen_for_ = sample.t - same_since_;
    frozen_at_ = same_since_;
  }
  last_ = sample;
  ++count_;
  if (const auto i = static_cast<std::size_t>((sample.t - first_) / kMean); i < kMostMeans) {
    if (i >= means_.size()) means_.resize(i + 1);
    means_[i].accel += sample.accel;
    means_[i].gyro += sample.gyro;
    ++means_[i].samples;
  }
}

void ImuCheck::report(Time origin, Diagnostics& diagnostics) const {
  if (count_ < kEnough) return;
  const bool frozen = frozen_for_ > kLongestFrozen;
  if (frozen)
    diagnostics.warn(
        "imu_frozen",
        fmt::format("the IMU gives the same reading for {:.3f} s from {:.3f} s on: it is frozen, or the "
                    "driver repeats what it had last",
                    static_cast<double>(frozen_for_) / kNsPerS, seconds_between(origin, frozen_at_)));
  report_channels(diagnostics);
  if (!frozen) report_axes(diagnostics);
}

void ImuCheck::report_channels(Diagnostics& diagnostics) const {
  std::string dead, clipped;
  for (std::size_t i = 0; i < kChannels; ++i) {
    const Channel& c = channels_[i];
    if (c.least == c.most) {
      dead += fmt::format("{}{} ({:.4g})", dead.empty() ? "" : ", ", kNames[i], c.least);
      continue;
    }
    constexpr std::int64_t kMany = 10;
    const bool low = c.at_least >= kMany && c.at_least < count_ / 2,
               high = c.at_most >= kMany && c.at_most < count_ / 2;
    const bool frozen = frozen_for_ > kLongestFrozen;
    if ((low || high) && !frozen)
      clipped +=
          fmt::format("{}{} at {:.4g}", clipped.empty() ? "" : ", ", kNames[i], high ? c.most : c.least);
  }
  if (!dead.empty())
    diagnostics.warn(
        "imu_dead_channel",
        fmt::format("the IMU's {} never changes: dead, or not provided; a run needs all six", dead));
  if (!clipped.empty())
    diagnostics.warn(
        "imu_clipped",
        fmt::format("the IMU's {} is cut off again and again: motion beyond it is lost; set a larger range",
                    clipped));
}

// What the accelerations themselves do is noise here. So this speaks only where one way fits well and the
// stated one does not at all.
void ImuCheck::report_axes(Diagnostics& diagnostics) const {
  constexpr std::size_t kLeast = 20;
  if (means_.size() < kLeast) return;
  std::vector<Vec3> change, accel, gyro;
  for (std::size_t i = 1; i + 1 < means_.size(); ++i) {
    const Mean &a = means_[i - 1], &b = means_[i], &c = means_[i + 1];
    if (a.samples == 0 || b.samples == 0 || c.samples == 0) continue;
    const auto mean = [](const Vec3& sum, const Mean& of) {
      return Vec3(sum / static_cast<double>(of.samples));
    };
    change.push_back((mean(c.accel, c) - mean(a.accel, a)) / (2e-9 * static_cast<double>(kMean)));
    accel.push_back(mean(b.accel, b));
    gyro.push_back(mean(b.gyro, b));
  }
  const auto fit = [&](const SignedAxes& axes) {
    double both = 0, seen = 0, expected = 0;
    for (std::size_t i = 0; i < change.size(); ++i) {
      const Vec3 turn = accel[i].cross(axes.apply(gyro[i]));
      both += change[i].dot(turn);
      seen += change[i].squaredNorm();
      expected += turn.squaredNorm();
    }
    return Fit{seen > 0 && expected > 0 ? both / std::sqrt(seen * expected) : 0,
               expected > 0 ? both / expected : 0};
  };
  constexpr double kGood = 0.6, kNone = 0.2, kRadPerDeg = 0.0174533;
  const SignedAxes as_stated;
  const Fit stated = fit(as_stated);
  if (stated.match > kGood && stated.scale > kRadPerDeg / 2 && stated.scale < kRadPerDeg * 2)
    diagnostics.warn(
        "gyro_unit",
        "the IMU's rates are some 57 times what gravity's direction turns by: they look like deg/s; rad/s "
        "are expected");
  if (stated.match > kNone) return;
  SignedAxes best = as_stated;
  Fit most = stated;
  for (const SignedAxes& axes : all_signed_axes())
    if (const Fit found = fit(axes); found.match > most.match) {
      best = axes;
      most = found;
    }
  if (most.match > kGood)
    diagnostics.warn(
        "gyro_axes",
        fmt::format(
            "the IMU's rates contradict how gravity turns in its accelerations; taken as {} they would "
            "fit: are axes swapped, mirrored or left-handed?",
            best.name()));
}

}  // namespace idol
