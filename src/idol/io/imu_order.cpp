#include "idol/io/imu_order.hpp"

#include <algorithm>
#include <utility>

namespace idol {

bool ImuOrder::push(const ImuSample& sample, std::string place) {
  if (given_ && sample.t < *given_) return false;
  const auto behind = std::upper_bound(held_.begin(), held_.end(), sample.t,
                                       [](Time t, const Sample& held) { return t < held.sample.t; });
  held_.insert(behind, {sample, std::move(place)});
  return true;
}

std::optional<ImuOrder::Sample> ImuOrder::pop(bool last) {
  constexpr Time kHeld = 50'000'000;  // [ns]
  if (held_.empty() || (!last && newest() - held_.front().sample.t < kHeld)) return std::nullopt;
  Sample sample = std::move(held_.front());
  held_.pop_front();
  given_ = sample.sample.t;
  return sample;
}

std::optional<Time> ImuOrder::before_newest() const {
  if (held_.size() > 1) return held_[held_.size() - 2].sample.t;
  return given_;
}

}  // namespace idol
