#include "idol/imu/imu_buffer.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace idol {
namespace {

bool earlier(const ImuSample& sample, Time t) { return sample.t < t; }

}  // namespace

void ImuBuffer::push(const ImuSample& sample) {
  const double t = static_cast<double>(sample.t) / kNsPerS;
  if (!sample.accel.allFinite() || !sample.gyro.allFinite()) {
    diagnostics_.warn("imu_not_finite", fmt::format("IMU sample at {:.6f} s is not a number: skipped", t));
    return;
  }
  if (!samples_.empty()) {
    if (sample.t <= samples_.back().t) {
      diagnostics_.warn("imu_stamp_not_increasing",
                        fmt::format("IMU stamp {:.6f} s repeats or goes back: sample skipped", t));
      return;
    }
    const double gap = seconds_between(samples_.back().t, sample.t);
    if (gap > max_gap_s_)
      diagnostics_.warn("imu_gap", fmt::format("no IMU data for {:.3f} s before {:.6f} s: bridged with inflated "
                                               "covariance, accuracy suffers there", gap, t));
  }
  samples_.push_back(sample);
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
