// What every estimator is to the rest of the program: states over time, lines, and the verbs of the schedule.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "idol/backend/anchored_line.hpp"
#include "idol/backend/chain_system.hpp"
#include "idol/backend/residuals.hpp"
#include "idol/base/rig.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol {

/// What one window saw of one segment.
struct LineObservation {
  LineId id = kNoLine;
  std::vector<EventMeasurement> events;  ///< the ones used one by one, in time order (batch)
  std::vector<LineBin> bins;             ///< all of them, compressed (fixed lag)
  std::int64_t event_count = 0;          ///< all of them
  EventMeasurement end_a, end_b;         ///< its two ends at the middle of its events' time
  bool candidate = false;                ///< may turn out to be no line (fixed lag)
};

struct WindowMeasurement {
  std::shared_ptr<const Preintegration> imu;  ///< of [begin, end)
  std::vector<LineObservation> lines;
  std::vector<Preintegrated> bin_motions;  ///< from the window's begin to each of its bin times
  bool still = false;                      ///< at rest at its begin
};

struct SolveStats {
  int lines = 0;      ///< in the problem
  int residuals = 0;  ///< scalar rows in the problem
  int iterations = 0;
  int restarts = 0;     ///< times so far that the estimator was lost and began anew
  bool settled = true;  ///< false after a start in motion or anew, until the velocity is known
  double cost = 0;
  double rms_px = 0;        ///< of the newest window's events to their lines
  double mean_track_s = 0;  ///< of the lines seen in the newest window
};

/// State between `a` and `b`, tenths of a second apart at most: cubic in position and in rotation, by the
/// velocities and these angular rates of the IMU at both ends [rad/s].
NavState state_between(const NavState& a, const Vec3& rate_a, const NavState& b, const Vec3& rate_b, Time t);

class Backend {
 public:
  explicit Backend(const Rig& rig, double gravity)
      : noise_(rig.imu),
        projection_{rig.camera, rig.T_i_c, Vec3(0, 0, -gravity)},
        time_offset_s_(rig.time_offset_s) {}
  virtual ~Backend() = default;

  /// First state, at the begin of the first window.
  virtual void start(const NavState& first, bool still) = 0;
  /// Appends a window: predicts the state at its end, files its observations. Windows follow each other in
  /// time.
  virtual void add(WindowMeasurement window) = 0;
  /// Optimises; then makes lines of the tracks that are ready, drops what does not fit.
  virtual SolveStats solve() = 0;
  /// After the last window: the best estimate of everything.
  virtual SolveStats finish() { return {}; }
  /// Mapped lines, by id.
  [[nodiscard]] virtual std::vector<Line> lines() const = 0;
  [[nodiscard]] virtual std::size_t line_count() const = 0;

  /// States at the begin of each window and at the end of the last.
  [[nodiscard]] const std::vector<NavState>& states() const { return states_; }
  [[nodiscard]] const NavState& latest() const { return states_.back(); }
  /// Of latest(), in the order position, rotation (about the IMU's axes), velocity, gyro bias, accelerometer
  /// bias, time shift, event lag; position and yaw relative to the start. Nullopt: this estimator has none.
  [[nodiscard]] virtual std::optional<StateMat> covariance() const { return std::nullopt; }
  /// State at any time of the windows so far, through the continuous representation (for windows of the past
  /// that are not optimised any more: state_between()); some milliseconds beyond the last too.
  [[nodiscard]] NavState state_at(Time t) const;
  /// The camera in the world when its own clock reads what the rig takes for `state.t`: stamped by that
  /// clock, and placed by the time shift that was found.
  [[nodiscard]] StampedPose camera_pose(const NavState& state) const;
  [[nodiscard]] const Projection& projection() const { return projection_; }
  /// The rig's, and what windows were re-timed by: t_imu = t_camera + this + NavState::time_shift [s].
  [[nodiscard]] double time_offset_s() const { return time_offset_s_; }
  /// From the next window on, windows come re-timed by so much more [s].
  void add_time_offset(double s) { time_offset_s_ += s; }

 protected:
  struct Window {
    std::shared_ptr<const Preintegration> imu;  // null once that is the past: it is large
    ImuBias bias;                               // that it was made with
    Vec3 rate_begin, rate_end;                  // [rad/s]
    bool still = false;
  };

  /// State at the end of the window from that at its begin; both lists grow by one.
  void append(const WindowMeasurement& window);

  ImuNoise noise_;
  Projection projection_;
  double time_offset_s_;
  std::vector<NavState> states_;
  std::vector<Window> windows_;
};

}  // namespace idol
