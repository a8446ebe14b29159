// The estimator: states, lines and the problem over them. Full batch at first, then the last windows (paper VI).
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "idol/backend/residuals.hpp"
#include "idol/base/options.hpp"
#include "idol/base/rig.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol {

struct BackendOptions {
  double event_sigma_px = 1.5;
  double huber_sigmas = 0.7;
  double observation_sigmas = 0.5;
  double repulsion_sigma_px = 10;
  double attraction_sigma = 10;
  int max_events_per_observation = 20;
  int max_lines_per_window = 40;
  int min_windows = 4;
  double first_depth_m = 2.0;
  double depth_prior_log = 1.0;
  double slant_prior_log = 0.5;
  double cull_px = 1.5;
  double batch_s = 24;
  int lag_windows = 30;
  int max_iterations = 8;
  double gravity = 9.81;
  double start_velocity_sigma = 0.02;
  double moving_velocity_sigma = 1.0;
  double gyro_bias_sigma = 0.003;
  double moving_gyro_bias_sigma = 0.03;
  double accel_bias_sigma = 0.2;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("event_sigma_px", self.event_sigma_px, Range{0.05, 100}, "standard deviation of an event-to-line distance [px]");
    visit("huber_sigmas", self.huber_sigmas, Range{0, 100},
          "distances beyond count by their size, not its square; 0: never (the paper)");
    visit("observation_sigmas", self.observation_sigmas, Range{0, 100},
          "Cauchy loss on what one window saw of one line, its RMS in event_sigma_px; 0: none (the paper)");
    visit("repulsion_sigma_px", self.repulsion_sigma_px, Range{0.1, 1e4}, "standard deviation of the repulsion (paper IV-B) [px]");
    visit("attraction_sigma", self.attraction_sigma, Range{0.1, 1e4}, "standard deviation of the attraction (paper IV-B) [sqrt px]");
    visit("max_events_per_observation", self.max_events_per_observation, Range{2, 1e6},
          "events used of one segment in one window, evenly spread over its time");
    visit("max_lines_per_window", self.max_lines_per_window, Range{1, 1e6}, "segments used of one window, longest tracks first");
    visit("min_windows", self.min_windows, Range{1, 100}, "windows that must see a segment before it becomes a line");
    visit("first_depth_m", self.first_depth_m, Range{0.05, 1000}, "depth of the first lines, before any is known [m]");
    visit("depth_prior_log", self.depth_prior_log, Range{0.01, 100},
          "standard deviation of the log depth of a new line: weak, keeps lines without parallax bounded");
    visit("slant_prior_log", self.slant_prior_log, Range{0.01, 100},
          "standard deviation of the log ratio of the depths of a new line's ends");
    visit("cull_px", self.cull_px, Range{0.1, 1000}, "an observation with a larger RMS is left out [px]");
    visit("batch_s", self.batch_s, Range{0, 1e6}, "full batch until this time since the start (paper VI) [s]");
    visit("lag_windows", self.lag_windows, Range{2, 1e6}, "windows optimised after that, the oldest pose fixed (paper VI)");
    visit("max_iterations", self.max_iterations, Range{1, 1000}, "of the solver per window");
    visit("gravity", self.gravity, Range{9, 10.5}, "[m/s^2]");
    visit("start_velocity_sigma", self.start_velocity_sigma, Range{1e-4, 10}, "velocity while the start is still [m/s]");
    visit("moving_velocity_sigma", self.moving_velocity_sigma, Range{1e-4, 100}, "first velocity after a moving start [m/s]");
    visit("gyro_bias_sigma", self.gyro_bias_sigma, Range{1e-6, 1}, "gyro bias found in a still start [rad/s]");
    visit("moving_gyro_bias_sigma", self.moving_gyro_bias_sigma, Range{1e-6, 1}, "gyro bias after a moving start [rad/s]");
    visit("accel_bias_sigma", self.accel_bias_sigma, Range{1e-6, 10}, "accelerometer bias at the start [m/s^2]");
  }
};

/// What one window saw of one segment.
struct LineObservation {
  LineId id = kNoLine;
  std::vector<EventMeasurement> events;  ///< the ones used, in time order
  std::int64_t event_count = 0;          ///< all of them
  EventMeasurement end_a, end_b;         ///< its two ends at the middle of its events' time
};

struct WindowMeasurement {
  std::shared_ptr<const Preintegration> imu;  ///< of [begin, end)
  std::vector<LineObservation> lines;
  bool still = false;                         ///< at rest at its begin
};

struct SolveStats {
  int lines = 0;         ///< in the problem
  int residuals = 0;     ///< scalar rows in the problem
  int iterations = 0;
  double cost = 0;
  double rms_px = 0;     ///< of the newest window's events to their lines
  double mean_track_s = 0;  ///< of the lines seen in the newest window
};

class Smoother {
 public:
  Smoother(const Rig& rig, const BackendOptions& options);
  ~Smoother();

  /// First state, at the begin of the first window.
  void start(const NavState& first, bool still);
  /// Appends a window: predicts the state at its end, files its observations. Windows follow each other in time.
  void add(WindowMeasurement window);
  /// Optimises the full batch or the last windows; then makes lines of the tracks that are ready, drops what does
  /// not fit.
  SolveStats solve();

  /// States at the begin of each window and at the end of the last.
  [[nodiscard]] const std::vector<NavState>& states() const { return states_; }
  [[nodiscard]] const NavState& latest() const { return states_.back(); }
  /// Inertial data between states()[i] and states()[i + 1].
  [[nodiscard]] const Preintegration& motion(std::size_t i) const { return *windows_[i].imu; }
  /// State at any time of the windows so far, through the continuous representation.
  [[nodiscard]] NavState state_at(Time t) const;
  /// Mapped lines, by id.
  [[nodiscard]] std::vector<Line> lines() const;
  [[nodiscard]] const Projection& projection() const { return projection_; }

 private:
  struct Observation {
    std::size_t window = 0;
    LineObservation seen;
    bool rejected = false;
  };
  struct Track {
    bool mapped = false;
    bool dead = false;
    LineEnds ends;
    Pose T_w_c_first;      // camera when the depth prior was set
    double prior_depth = 0;
    std::vector<Observation> observations;
  };
  struct Window {
    std::shared_ptr<const Preintegration> imu;
    bool still = false;
  };
  class Problem;

  [[nodiscard]] std::size_t first_active() const;
  [[nodiscard]] NavState state_of(const Observation& o, const EventMeasurement& e) const;
  [[nodiscard]] double observation_rms(const Track& track, const Observation& o) const;
  [[nodiscard]] double typical_depth() const;
  void make_lines();
  [[nodiscard]] bool initialise(Track& track) const;
  void cull();
  [[nodiscard]] SolveStats newest_stats() const;

  BackendOptions options_;
  ImuNoise noise_;
  Projection projection_;
  std::vector<NavState> states_;
  std::vector<Window> windows_;
  std::map<LineId, Track> tracks_;
  bool still_start_ = false;
  NavState first_guess_;
};

}  // namespace idol
