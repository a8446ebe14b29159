// Whether the time offset that the rig states is wrong by more than the estimator can find by itself, judged
// once, in the first second of motion.
#pragma once

#include <deque>
#include <memory>
#include <optional>

#include "idol/imu/imu_buffer.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/odometry/gyro_offset.hpp"
#include "idol/odometry/odometry_options.hpp"
#include "idol/odometry/segmented.hpp"
#include "idol/odometry/window_estimator.hpp"

namespace idol {

/// An estimator of its own takes the windows as they come, with a wide prior about its time shift. When it
/// knows the shift well, or motion has lasted long enough, it is judged: a shift near zero that the gyro does
/// not contradict is right. Else the windows are taken up again from the last rest on, moved by the gyro's or
/// the estimator's offset, until the estimator finds nothing to move any more: that is the correction. Where
/// this does not come to an end or is not sure, nothing is corrected. docs/backend.md, "Time offset".
class TimeOffsetSearch {
 public:
  /// `imu` and `undistort` must outlive it; `imu` keeps the samples from keep_from() on.
  TimeOffsetSearch(const Rig& rig, const Options& options, const UndistortMap& undistort,
                   const ImuBuffer& imu);

  /// The state at the begin of the first window.
  void start(const ImuInit& init, Time begin);
  enum class Progress { kResting, kMoving, kJudged };
  /// The next window, IMU samples and all.
  Progress add(std::shared_ptr<const Segmented> segmented);
  /// No window will come any more.
  void judge();
  /// By how much windows must be moved, once judged; 0: not at all [s].
  [[nodiscard]] double correction_s() const { return correction_s_; }
  /// What of the IMU it may still need.
  [[nodiscard]] Time keep_from() const;

 private:
  struct Shift {
    double s = 0, sigma = 0;  // [s]
    bool valid = false;       // found without a restart
  };
  void make_trial();
  [[nodiscard]] Shift shift_of_trial() const;
  [[nodiscard]] std::optional<GyroOffset::Result> ask_gyro() const;
  [[nodiscard]] Shift try_offset(double offset_s);
  [[nodiscard]] std::optional<double> converge(double offset_s);

  const Rig& rig_;
  Options options_;
  const UndistortMap& undistort_;
  const ImuBuffer& imu_;
  GyroOffset gyro_;
  std::unique_ptr<WindowEstimator> trial_;
  ImuInit init_;
  bool restarted_ = false;                                // the trial
  std::deque<std::shared_ptr<const Segmented>> windows_;  // since shortly before the motion's begin
  double moving_s_ = 0;
  double correction_s_ = 0;
};

}  // namespace idol
