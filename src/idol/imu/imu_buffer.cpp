#include "idol/imu/imu_buffer.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace idol {
namespace {

bool earlier(const ImuSample& sample, Time t) { return sample.t < t; }

double in_seconds(Time t) { return static_cast<double>(t) / kNsPerS; }

}  // namespace

void ImuBuffer::push(const ImuSample& sample) {
  if (!sample.accel.allFinite() || !sample.gyro.allFinite()) {
    diagnostics_.warn("imu_not_finite",
                      fmt::format("IMU sample at {:.6f} s is not a number: skipped", in_seconds(sample.t)));
    return;
  }
  if (newest_stamp_ && sample.t < *newest_stamp_) {
    ready_.repeats.push_back(sample);
  } else {
    newest_stamp_ = sample.t;
    bursts_.push(sample, ready_);
  }
  append_ready();
}

void ImuBuffer::flush() {
  bursts_.flush(ready_);
  append_ready();
}

void ImuBuffer::append_ready() {
  for (const ImuSample& sample : ready_.repeats)
    diagnostics_.warn(
        "imu_stamp_not_increasing",
        fmt::format("IMU stamp {:.6f} s repeats or goes back: sample skipped", in_seconds(sample.t)));
  for (const ImuSample& sample : ready_.samples) {
    const double gap = samples_.empty() ? 0.0 : seconds_between(samples_.back().t, sample.t);
    if (gap > max_gap_s_)
      diagnostics_.warn("imu_gap",
                        fmt::format("no IMU data for {:.3f} s before {:.6f} s: bridged with inflated "
                                    "covariance, accuracy suffers there",
                                    gap, in_seconds(sample.t)));
    samples_.push_back(sample);
  }
  if (!ready_.samples.empty()) bursts_.report("", diagnostics_);
  ready_.samples.clear();
  ready_.repeats.clear();
}

bool ImuBuffer::covers(Time t, int count) const {
  const auto after = std::lower_bound(samples_.begin(), samples_.end(), t, earlier);
  return samples_.end() - after >= count;
}

std::vector<ImuSample> ImuBuffer::slice(Time t0, Time t1, int margin) const {
  auto first = std::lower_bound(samples_.begin(), samples_.end(), t0, earlier);
  auto last = std::lower_bound(first, samples_.end(), t1 + 1, earlier);
  first -= std::min<std::ptrdiff_t>(margin, first - samples_.begin());
  last += std::min<std::ptrdiff_t>(margin, samples_.end() - last);
  return {first, last};
}

void ImuBuffer::drop_before(Time t, int keep) {
  const auto first = std::lower_bound(samples_.begin(), samples_.end(), t, earlier);
  const auto excess = (first - samples_.begin()) - keep;
  if (excess > 0) samples_.erase(samples_.begin(), samples_.begin() + excess);
}

}  // namespace idol
