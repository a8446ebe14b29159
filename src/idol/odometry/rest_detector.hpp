// Tells whether the sensor is at rest, from both of its halves.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "idol/base/types.hpp"
#include "idol/frontend/windower.hpp"

namespace idol {

/// At rest only noise and tremor make events, and motion multiplies them, mostly before the IMU tells it from
/// its own noise: a rest ends when the events say so, by their number or by lines that move on,
/// or when the IMU reads something else for longer than a tremor's period. The events cannot
/// tell a rest from motion in front of a blank wall or in the dark: a rest begins only when the IMU agrees,
/// for some windows on end. It is asked for the readings of the last rest, if there was one, as the
/// accelerometer's bias is not known well.
class RestDetector {
 public:
  /// `still`: the IMU says that the recording begins at rest, until `known_until` at least.
  void begin(bool still, Time known_until);
  /// For each window in turn: its events, whether the lines that they form have moved on (ImageMotion), how
  /// many of them are noise (of hot pixels, or of no line and without neighbours), the IMU data of its time.
  bool update(const EventWindow& window, bool image_moves, std::int64_t noise, std::span<const ImuSample> imu,
              const ImuBias& bias, double gravity);

 private:
  // Of some windows.
  struct Usual {
    int windows = 0;
    double events = 0, events_square = 0;           // mean number a second; sum of the squares beside it
    Eigen::Vector4d imu = Eigen::Vector4d::Zero();  // mean angular rate, norm of the mean specific force
    Vec3 force = Vec3::Zero();                      // mean specific force
    void add(double events_per_s, const Eigen::Vector4d& imu_readings, const Vec3& mean_force);
  };
  [[nodiscard]] double margin(double duration) const;
  [[nodiscard]] bool imu_moves(const Vec3& rate, const Vec3& force, double duration);

  bool resting_ = false, interrupted_ = false;  // by the last window
  Time known_until_ = 0;
  Usual rest_;                                                     // this one, or the last
  Usual quiet_;                                                    // what may become a rest,
  double quiet_s_ = 0;                                             // for so long
  Vec3 rate_beside_ = Vec3::Zero(), force_beside_ = Vec3::Zero();  // of late, from those of this rest
};

}  // namespace idol
