#include "idol/io/sensor_clock.hpp"

#include <algorithm>
#include <cstdlib>

namespace idol {
namespace {

/// `t` less as many wraps as bring it nearest to zero.
Time nearest_to_zero(Time t) {
  constexpr Time kHalf = SensorClock::kWrap / 2;
  const Time rest = t % SensorClock::kWrap;
  if (rest >= kHalf) return rest - SensorClock::kWrap;
  return rest < -kHalf ? rest + SensorClock::kWrap : rest;
}

}  // namespace

void SensorClock::add(Time stamp, std::int64_t sensor_us) {
  const Time offset = stamp - sensor_us * 1000;
  if (offsets_.empty()) reference_ = offset;
  offsets_.push_back(nearest_to_zero(offset - reference_));
}

Time SensorClock::offset() const {
  std::vector<Time> sorted = offsets_;
  const auto middle = sorted.begin() + std::ssize(sorted) / 2;
  std::nth_element(sorted.begin(), middle, sorted.end());
  return reference_ + *middle;
}

Time SensorClock::ros_time(std::int64_t sensor_us, Time stamp) const {
  return stamp + nearest_to_zero(sensor_us * 1000 + offset() - stamp);
}

SensorClock::Disagreement SensorClock::disagreement() const {
  constexpr Time kMuch = 50'000'000;
  Disagreement found;
  for (const Time t : offsets_) {
    const Time off = std::abs(nearest_to_zero(t - (offset() - reference_)));
    if (off > kMuch) ++found.messages;
    found.most_s = std::max(found.most_s, static_cast<double>(off) / kNsPerS);
  }
  return found;
}

}  // namespace idol
