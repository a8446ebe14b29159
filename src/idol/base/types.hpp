// The plain data that flows through the program. Conventions: docs/conventions.md.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "idol/base/lie.hpp"

namespace idol {

/// Absolute time, nanoseconds of the recording's clock.
using Time = std::int64_t;

constexpr double kNsPerS = 1e9;

/// Seconds from `from` to `to` [s].
inline double seconds_between(Time from, Time to) { return static_cast<double>(to - from) / kNsPerS; }

/// A duration in seconds as nanoseconds, rounded to nearest.
inline Time from_seconds(double s) { return static_cast<Time>(std::llround(s * kNsPerS)); }

/// One event of the camera: time of its own clock, raw pixel, sign of the brightness change.
struct Event {
  Time t = 0;
  std::uint16_t x = 0;
  std::uint16_t y = 0;
  bool polarity = false;

  bool operator==(const Event&) const = default;
};

/// One reading of the IMU, in its own frame.
struct ImuSample {
  Time t = 0;
  Vec3 accel = Vec3::Zero();  ///< specific force [m/s^2]
  Vec3 gyro = Vec3::Zero();   ///< angular rate [rad/s]
};

/// Angular rate of the camera, in its own frame.
struct CameraRate {
  Time t = 0;
  Vec3 omega = Vec3::Zero();  ///< [rad/s]
};

/// A chunk of a recording. Each stream is in time order; chunk borders carry no meaning.
struct Packet {
  std::vector<Event> events;
  std::vector<ImuSample> imu;
};

/// Pose of a named body in the world at a time.
struct StampedPose {
  Time t = 0;
  Pose T;
};

using Trajectory = std::vector<StampedPose>;

/// Constant errors of the IMU: reading = truth + bias + noise.
struct ImuBias {
  Vec3 gyro = Vec3::Zero();   ///< [rad/s]
  Vec3 accel = Vec3::Zero();  ///< [m/s^2]
};

/// Motion state of the IMU in the world.
struct NavState {
  Time t = 0;
  Pose T_w_i;
  Vec3 v_w = Vec3::Zero();  ///< velocity in the world [m/s]
  ImuBias bias;
  double time_shift = 0;  ///< of the camera's clock, beyond Rig::time_offset_s: t_imu = t_camera + both [s]
  /// How far events trail the edge that makes them, at any speed: a pixel fires once its contrast is reached
  /// [px]
  double event_lag_px = 0;
};

using LineId = std::int64_t;
constexpr LineId kNoLine = -1;

/// A mapped 3D line segment, with its history.
struct Line {
  LineId id = kNoLine;
  Vec3 a = Vec3::Zero();  ///< one end in the world [m]
  Vec3 b = Vec3::Zero();  ///< the other end in the world [m]
  Time first = 0;         ///< first and last window that saw it
  Time last = 0;
  int windows = 0;
  std::int64_t events = 0;
};

}  // namespace idol
