// From the front-end's windows to states: measurements of lines, the IMU and rest, for one estimator.
#pragma once

#include <map>
#include <memory>
#include <span>
#include <vector>

#include "idol/backend/backend.hpp"
#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/odometry/image_motion.hpp"
#include "idol/odometry/odometry_options.hpp"
#include "idol/odometry/rest_detector.hpp"
#include "idol/odometry/segmented.hpp"

namespace idol {

class WindowEstimator {
 public:
  /// `undistort` must outlive it.
  WindowEstimator(const Rig& rig, const Options& options, const UndistortMap& undistort);

  /// The state at the begin of the first window.
  void start(const ImuInit& init, Time begin);
  struct Outcome {
    SolveStats stats;
    bool still = false;                   ///< at rest at the window's begin
    double integrate_s = 0, solve_s = 0;  ///< wall time
  };
  /// The next window.
  Outcome estimate(const Segmented& segmented);
  /// From the next window on, windows come re-timed by so much more.
  void add_time_offset(double s) { backend_->add_time_offset(s); }

  [[nodiscard]] Backend& backend() { return *backend_; }
  [[nodiscard]] const Backend& backend() const { return *backend_; }
  [[nodiscard]] const Diagnostics& diagnostics() const { return diagnostics_; }

 private:
  void check_quality(const SampleQuality& quality, const EventWindow& window);
  [[nodiscard]] std::vector<LineObservation> observe(const EventWindow& window,
                                                     const SegmentedWindow& segments,
                                                     const Preintegration& imu) const;
  [[nodiscard]] std::vector<EventMeasurement> choose_events(const EventWindow& window,
                                                            std::span<const std::uint32_t> events,
                                                            const Preintegration& imu) const;
  [[nodiscard]] std::vector<LineBin> compress_events(const EventWindow& window,
                                                     std::span<const std::uint32_t> events,
                                                     const Segment& segment) const;
  [[nodiscard]] int bin_count(const EventWindow& window) const;

  ImuNoise noise_;
  Options options_;
  const UndistortMap& undistort_;
  std::unique_ptr<Backend> backend_;
  ImageMotion motion_;
  RestDetector rest_;
  std::int64_t noise_events_ = 0;        // by now, for its differences
  std::map<LineId, int> track_windows_;  // how many windows saw each segment so far
  Diagnostics diagnostics_;
};

}  // namespace idol
