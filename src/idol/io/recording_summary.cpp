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

void PixelActivity::grow(int x, int y) {
  const int old_stride = stride_;
  const int old_rows = rows_;
  if (stride_ == 0) stride_ = rows_ = 256;
  while (x >= stride_) stride_ *= 2;
  while (y >= rows_) rows_ *= 2;
  std::vector<Pixel> larger(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(rows_));
  for (int row = 0; row < old_rows; ++row) {
    std::copy_n(pixels_.begin() + static_cast<std::ptrdiff_t>(row) * old_stride, old_stride,
                larger.begin() + static_cast<std::ptrdiff_t>(row) * stride_);
  }
  pixels_ = std::move(larger);
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

void RecordingSummary::Stream::add(Time t) {
  if (count == 0) first = last = t;
  if (t - last > longest_pause) {
    longest_pause = t - last;
    longest_pause_at = last;
  }
  last = t;
  ++count;
}

double RecordingSummary::Stream::rate_hz() const {
  return last > first ? static_cast<double>(count - 1) / duration_s() : 0.0;
}

void RecordingSummary::add(const Packet& packet) {
  constexpr int kLargestPixel = 8191;  // beyond it no sensor, only damage, and no memory for it
  for (const Event& event : packet.events) {
    events.add(event.t);
    rate.add(event.t);
    on_events += event.polarity ? 1 : 0;
    if (width_ > 0 && (event.x >= width_ || event.y >= height_)) ++outside;
    if (event.x > kLargestPixel || event.y > kLargestPixel) continue;
    largest_x = std::max<int>(largest_x, event.x);
    largest_y = std::max<int>(largest_y, event.y);
    pixels.add(event.x, event.y, span_of(event.t));
  }
  for (const ImuSample& sample : packet.imu) {
    if (imu.count > 0) ++imu_periods_us[(sample.t - imu.last + 500) / 1000];
    imu.add(sample.t);
    gyro.add(sample.gyro);
    accel.add(sample.accel);
    accel_norm_sum += sample.accel.norm();
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

std::vector<std::pair<int, int>> RecordingSummary::hot_pixels() const {
  constexpr double kLeastShare = 0.65;   // of the spans in which a hot pixel fires
  constexpr double kLargestShare = 0.7;  // the median pixel around it, relative to it
  constexpr std::uint32_t kFewestSpans = 40;
  const std::uint32_t all = events.count > 0 ? span_of(events.last) : 0;
  std::vector<std::pair<int, int>> hot;
  if (all < kFewestSpans) return hot;
  std::vector<std::uint32_t> around;
  for (int y = 0; y <= largest_y; ++y) {
    for (int x = 0; x <= largest_x; ++x) {
      const double spans = pixels.spans(x, y);
      if (spans < kLeastShare * all) continue;
      around.clear();
      for (int v = std::max(0, y - 2); v <= std::min(largest_y, y + 2); ++v)
        for (int u = std::max(0, x - 2); u <= std::min(largest_x, x + 2); ++u)
          if (u != x || v != y) around.push_back(pixels.spans(u, v));
      if (around.empty()) continue;
      const auto median = around.begin() + static_cast<std::ptrdiff_t>(around.size() / 2);
      std::nth_element(around.begin(), median, around.end());
      if (*median < kLargestShare * spans) hot.emplace_back(x, y);
    }
  }
  return hot;
}

}  // namespace idol
