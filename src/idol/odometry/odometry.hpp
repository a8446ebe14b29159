// The method on one page: events and IMU readings in, states and lines out.
#pragma once

#include <deque>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "idol/backend/backend.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/input_check.hpp"
#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/image/flicker_filter.hpp"
#include "idol/imu/imu_buffer.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/odometry/background.hpp"
#include "idol/odometry/odometry_options.hpp"
#include "idol/odometry/segmented.hpp"
#include "idol/odometry/time_offset_search.hpp"
#include "idol/odometry/window_estimator.hpp"

namespace idol {

/// What is known after a window. References are valid during the call that hands it over.
struct Estimate {
  NavState state;  ///< at the window's end, as just published
  const EventWindow& window;
  const SegmentedWindow& segments;
  const Backend& smoother;
  SolveStats stats;
  double segment_s = 0, integrate_s = 0, solve_s = 0;  ///< wall time of the stages
  SegmenterCounts counts;                              ///< of all events up to this window
};

class Odometry {
 public:
  Odometry(const Rig& rig, const Options& options);

  /// Called after each window: with one thread in that which pushes, with two in the back-end's, one call at
  /// a time.
  void on_estimate(std::function<void(const Estimate&)> listener) { listener_ = std::move(listener); }
  /// Any chunk size; each stream in time order. What cannot be used (pixels outside the rig, stamps that go
  /// back or lie minutes ahead, values that are not finite) is left out and counted. Throws DataError on a
  /// start that cannot be used, and what a listener or an estimation threw before: no more is estimated then.
  /// Waits when the back-end is some windows behind. IMU samples may come in bursts with one stamp
  /// (ImuBursts).
  void push(const ImuSample& sample);
  void push(std::span<const Event> events);
  /// Says that no IMU sample will come any more: what events still bring is dropped, not kept waiting.
  void end_imu();
  /// Last, partial window and what waits for IMU data that will not come. Throws DataError when no start has
  /// been found.
  void finish();
  /// Returns when all windows cut so far are estimated. Throws what their estimation threw; UsageError in a
  /// listener, which would wait for itself.
  void wait();

  /// After wait() or finish() only, until the next push.
  [[nodiscard]] const Backend& smoother() const { return estimator_.backend(); }
  /// True once a window has been estimated.
  [[nodiscard]] bool started() const { return newest().has_value(); }
  /// Newest estimate carried on to `t` (IMU clock) by the samples present, at any rate and in the thread that
  /// pushes; nullopt before the start, before the newest estimate (smoother().state_at() has what was) or
  /// beyond the data.
  [[nodiscard]] std::optional<NavState> predict_at(Time t) const;
  [[nodiscard]] SegmenterCounts event_counts() const { return segmenter_->counts(); }
  /// What each stage of the front-end let through so far; nullopt for clusters.
  [[nodiscard]] std::optional<StageCounts> front_end_stages() const { return segmenter_->stages(); }
  /// All oddities met so far. After wait() or finish() only.
  [[nodiscard]] Diagnostics diagnostics() const;

 private:
  void take(const Event& event, bool is_flicker);
  void process_ready(bool last);
  void prepare();
  void drop_waiting();
  void segment(EventWindow&& window);
  void take_up(bool last);
  [[nodiscard]] bool find_start(bool last);
  [[nodiscard]] bool image_moves(Time until) const;
  void correct_time_offset();
  void hand_over_held(bool last);
  void start();
  void run(std::function<void()> job);
  void estimate(const Segmented& segmented);
  [[nodiscard]] std::vector<ImuSample> imu_samples(Time from, Time to) const;
  [[nodiscard]] std::vector<CameraRate> rates_of(std::span<const ImuSample> samples) const;
  [[nodiscard]] std::optional<NavState> newest() const;

  Rig rig_;
  Options options_;
  PushCheck<Event> event_check_;
  PushCheck<ImuSample> imu_check_;
  UndistortMap undistort_;
  ImuBuffer imu_;
  std::optional<FlickerFilter> flicker_filter_;
  Windower windower_;
  std::unique_ptr<Segmenter> segmenter_;
  WindowEstimator estimator_;
  std::optional<EventWindow> waiting_;
  std::deque<std::shared_ptr<Segmented>> held_;  // windows of which start or time offset are to be found
  std::optional<ImuInit> init_;
  bool started_ = false;
  std::string start_failure_;
  std::unique_ptr<TimeOffsetSearch> offset_search_;  // until the offset is judged
  std::size_t searched_ = 0;                         // of the windows held, by it
  Time correction_ = 0;         // of the rig's time offset: by so much windows are moved behind the front-end
  Time handed_over_until_ = 0;  // windows
  bool imu_over_ = false;
  Time prepared_ = std::numeric_limits<Time>::min();  // up to where the open window has been looked at
  double prepare_s_ = 0;                              // what that took
  std::function<void(const Estimate&)> listener_;
  Diagnostics diagnostics_;
  mutable std::mutex newest_mutex_;
  std::optional<NavState> newest_;
  bool failed_ = false;                     // in run()
  std::unique_ptr<Background> background_;  // last: its jobs use all of the above
};

}  // namespace idol
