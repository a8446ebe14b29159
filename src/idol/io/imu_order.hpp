// IMU samples put back in time order, where a driver or a network swapped some.
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <string>

#include "idol/base/types.hpp"

namespace idol {

/// Holds the samples of the last 50 ms. What is later than that cannot be put in its place any more.
class ImuOrder {
 public:
  struct Sample {
    ImuSample sample;
    std::string place;  ///< in the file, where somebody may ask for it; else empty
  };

  /// False: the sample is too late and was not taken.
  bool push(const ImuSample& sample, std::string place);
  /// The next sample whose place in the order is settled; with `last`, any.
  std::optional<Sample> pop(bool last);
  /// Takes out the newest one, whose stamp turned out to be wrong.
  void drop_newest() { held_.pop_back(); }

  [[nodiscard]] bool empty() const { return held_.empty(); }
  [[nodiscard]] Time newest() const { return held_.back().sample.t; }
  /// The newest but one, of those held or given out.
  [[nodiscard]] std::optional<Time> before_newest() const;

 private:
  std::deque<Sample> held_;  // sorted; equal stamps as they came
  std::optional<Time> given_;
};

}  // namespace idol
