// Tells whether the sensor is at rest, from both of its halves.
#pragma once

#include <span>

#include "idol/base/types.hpp"
#include "idol/frontend/windower.hpp"

namespace idol {

/// At rest only noise and tremor make events, and motion multiplies them long before the IMU tells it from
/// its own noise: a rest ends when the events say so, by their number or by forming lines. The events cannot
/// tell a rest from motion in front of a blank wall or in the dark: a rest begins only when the IMU agrees,
/// for some windows on end.
class RestDetector {
 public:
  /// `still`: the IMU says that the recording begins at rest, until `known_until` at least.
  void begin(bool still, Time known_until);
  /// For each window in turn: its events, how many line segments they form, the IMU data of its time.
  bool update(const EventWindow& window, std::size_t segments, std::span<const ImuSample> imu,
              const ImuBias& bias, double gravity);

 private:
  bool resting_ = false;
  Time known_until_ = 0;
  double rest_rate_ = 0;  // events per second at rest, mean over rest_windows_
  int rest_windows_ = 0;
  double quiet_s_ = 0;  // how long both have been quiet by now
};

}  // namespace idol
