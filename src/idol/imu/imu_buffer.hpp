// Time-ordered IMU samples waiting to be integrated.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"
#include "idol/imu/imu_bursts.hpp"

namespace idol {

/// Keeps samples in time order, those that came in bursts with one stamp at times of their own (ImuBursts);
/// refuses repeats, steps back in time and readings that are not numbers, and counts them and the gaps
/// (longer than `max_gap_s`) in diagnostics().
class ImuBuffer {
 public:
  explicit ImuBuffer(double max_gap_s = 0.1) : max_gap_s_(max_gap_s) {}

  /// What ImuBursts holds back is there after a later push, or flush().
  void push(const ImuSample& sample);
  /// No sample will follow soon: what is held back is there now.
  void flush();
  /// True if `count` samples at or after `t` are present.
  [[nodiscard]] bool covers(Time t, int count = 1) const;
  /// Samples of [t0, t1] and up to `margin` more on each side, fewer where the buffer ends.
  [[nodiscard]] std::vector<ImuSample> slice(Time t0, Time t1, int margin) const;
  /// Forgets samples before `t` except the last `keep` of them.
  void drop_before(Time t, int keep);

  [[nodiscard]] bool empty() const { return samples_.empty(); }
  [[nodiscard]] Time front_time() const { return samples_.front().t; }
  [[nodiscard]] Time back_time() const { return samples_.back().t; }
  [[nodiscard]] const Diagnostics& diagnostics() const { return diagnostics_; }

 private:
  void append_ready();

  ImuBursts bursts_;
  ImuBursts::Output ready_;
  std::optional<Time> newest_stamp_;
  std::deque<ImuSample> samples_;
  double max_gap_s_;
  Diagnostics diagnostics_;
};

}  // namespace idol
