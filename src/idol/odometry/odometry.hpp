// The method on one page: events and IMU readings in, states and lines out.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "idol/backend/backend.hpp"
#include "idol/backend/backend_options.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/input_check.hpp"
#include "idol/base/options.hpp"
#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/image/flicker_filter.hpp"
#include "idol/imu/imu_buffer.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/odometry/background.hpp"
#include "idol/odometry/image_motion.hpp"
#include "idol/odometry/rest_detector.hpp"

namespace idol {

struct EventFilterOptions {
  bool flicker = true;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("flicker", self.flicker, Range{},
          "leave out the events of lamps that flicker at 86 to 134 Hz, which is twice the mains' frequency");
  }
};

struct PipelineOptions {
  int threads = 2;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("threads", self.threads, Range{1, 2},
          "2: the back-end works in a thread of its own while the front-end goes on; results are the same");
  }
};

struct Options {
  EventFilterOptions filter;
  WindowOptions window;
  SegmentOptions segment;
  PreintegrationOptions imu;
  ImuInitOptions start;
  BackendOptions backend;
  PipelineOptions pipeline;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("filter", self.filter, Range{}, "");
    visit("window", self.window, Range{}, "");
    visit("segment", self.segment, Range{}, "");
    visit("imu", self.imu, Range{}, "");
    visit("start", self.start, Range{}, "");
    visit("backend", self.backend, Range{}, "");
    visit("pipeline", self.pipeline, Range{}, "");
  }
};

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
  [[nodiscard]] const Backend& smoother() const { return *smoother_; }
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
  // A window as the front-end leaves it.
  struct Segmented {
    EventWindow window;
    SegmentedWindow segments;
    std::vector<ImuSample> samples;
    double segment_s = 0;
    SegmenterCounts counts;
  };
  void segment(EventWindow&& window);
  void start_when_known(bool last);
  void start(const ImuInit& init);
  void hand_over(std::shared_ptr<const Segmented> segmented);
  void estimate_here(const Segmented& segmented);
  [[nodiscard]] bool image_moves() const;
  void estimate(const Segmented& segmented);
  [[nodiscard]] std::optional<NavState> newest() const;
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

  Rig rig_;
  Options options_;
  PushCheck<Event> event_check_;
  PushCheck<ImuSample> imu_check_;
  UndistortMap undistort_;
  ImuBuffer imu_;
  std::optional<FlickerFilter> flicker_filter_;
  Windower windower_;
  std::unique_ptr<Segmenter> segmenter_;
  std::unique_ptr<Backend> smoother_;
  std::optional<EventWindow> waiting_;
  bool started_ = false;
  std::deque<std::shared_ptr<const Segmented>> held_;  // windows of which the start is to be found
  std::string start_failure_;
  bool imu_over_ = false;
  Time prepared_ = std::numeric_limits<Time>::min();  // up to where the open window has been looked at
  double prepare_s_ = 0;                              // what that took
  ImageMotion motion_;
  RestDetector rest_;
  std::int64_t noise_events_ = 0;        // by now, for its differences
  std::map<LineId, int> track_windows_;  // how many windows saw each segment so far
  std::function<void(const Estimate&)> listener_;
  Diagnostics diagnostics_, backend_diagnostics_;
  mutable std::mutex newest_mutex_;
  std::optional<NavState> newest_;
  bool failed_ = false;                     // in estimate_here()
  std::unique_ptr<Background> background_;  // last: its jobs use all of the above
};

}  // namespace idol
