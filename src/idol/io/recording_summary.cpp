#include "idol/io/recording_summary.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace idol {

void RateHistogram::add(Time t) {
  if (counts_.empty()) first_ = t;
  constexpr std::size_t kMostBins = 1024;
  std::size_t bin = static_cast<std::size_t>((t - first_) / bin_);
  while (bin >= kMostBins) {
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      const std::int64_t count = std::exchange(counts_[i], 0);
      counts_[i / 2] += count;
    }
    counts_.resize((counts_.size() + 1) / 2);
    bin_ *= 2;
    bin = static_cast<std::size_t>((t - first_) / bin_);
  }
  if (bin >= counts_.size()) counts_.resize(bin + 1, 0);
  ++counts_[bin];
}

void VectorStats::add(const Vec3& v) {
  ++count;
  const Vec3 before = v - mean;
  mean += before / static_cast<double>(count);
  squares += before.cwiseProduct(v - mean);
}

double VectorStats::scatter() const {
  return count > 1 ? std::sqrt(squares.sum() / static_cast<double>(count)) : 0.0;
}

void RecordingSummary::add(const Packet& packet) {
  events.add(packet.events);
  clocks.add(packet);
  for (const Event& event : packet.events) rate.add(event.t);
  for (const ImuSample& sample : packet.imu) {
    if (imu.count > 0) ++imu_periods_us[(sample.t - imu.last + 500) / 1000];
    imu.add(sample.t);
    gyro.add(sample.gyro);
    accel.add(sample.accel);
    accel_norm_sum += sample.accel.norm();
    imu_check.add(sample);
  }
}

std::optional<double> RecordingSummary::imu_period_s() const {
  std::int64_t left = imu.count / 2;
  for (const auto& [period, count] : imu_periods_us)
    if ((left -= count) <= 0) return static_cast<double>(period) * 1e-6;
  return std::nullopt;
}

std::int64_t RecordingSummary::imu_gaps() const {
  const double limit_us = 10e6 * imu_period_s().value_or(0);
  std::int64_t gaps = 0;
  for (const auto& [period, count] : imu_periods_us)
    if (static_cast<double>(period) > limit_us) gaps += count;
  return gaps;
}

}  // namespace idol
