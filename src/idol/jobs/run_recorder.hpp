// What a run leaves behind: collected while it goes, written at its end (or at its failure).
#pragma once

#include <chrono>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "idol/jobs/tracking_verdict.hpp"
#include "idol/odometry/odometry.hpp"
#include "idol/report/event_log.hpp"
#include "idol/report/picture.hpp"
#include "idol/view/sight.hpp"

namespace idol {

class RunRecorder {
 public:
  using Clock = std::chrono::steady_clock;

  /// `dir` empty: nothing is to be written. `rate_hz` 0: one pose an estimate; else both trajectories are
  /// sampled at this rate. The causal one begins when the estimator has settled, 1.5 s after the first window
  /// at the latest.
  RunRecorder(std::filesystem::path dir, const Rig& rig, double rate_hz);

  /// In any thread, one call at a time.
  void add(const Estimate& estimate, const Sight& sight);

  /// Live replay: returns when as much time has passed since the first call as between its event and this
  /// one.
  void wait_until_due(Time event);
  struct Latency {
    double median = 0, p99 = 0, worst = 0;  ///< from a window's last event to its pose [s]
  };
  /// Of a live replay, once the start is over.
  [[nodiscard]] std::optional<Latency> latency() const;

  struct Summary {
    std::string sequence, preset, status;  ///< status: "done", "interrupted", or the error's text
    std::int64_t events = 0;
    double read_s = 0;
    Diagnostics diagnostics;
  };
  /// Trajectories, states, lines, windows, pictures and shown events, if there is an estimate. Throws
  /// DataError when the disk refuses.
  void write_results(const Odometry& odometry) const;
  /// The text of stats.json.
  [[nodiscard]] std::string stats_json(const Odometry& odometry, const Summary& summary) const;

  struct Trajectories {
    Trajectory imu, camera;                ///< best estimate at the end, each by its sensor's own clock
    Trajectory imu_causal, camera_causal;  ///< as first published
  };
  /// Empty without an estimate.
  [[nodiscard]] Trajectories trajectories(const Odometry& odometry) const;

  [[nodiscard]] TrackingFacts tracking() const;
  [[nodiscard]] std::size_t windows() const { return rows_.size(); }
  /// Length of what has been estimated so far [s].
  [[nodiscard]] double data_s() const {
    const std::lock_guard lock(rows_mutex_);
    return rows_.empty() ? 0 : seconds_between(rows_.front().t, rows_.back().t) + rows_.front().duration_s;
  }
  [[nodiscard]] int lines() const {
    const std::lock_guard lock(rows_mutex_);
    return rows_.empty() ? 0 : rows_.back().stats.lines;
  }

 private:
  struct Row {
    Time t = 0;
    double duration_s = 0;
    std::size_t events = 0, segments = 0;
    std::size_t lines_seen = 0;  // mapped ones among the segments
    SegmenterCounts counts;      // of this window alone
    double speed_px_s = 0;       // of the segments across themselves, median
    SolveStats stats;
    StateVec sigma = StateVec::Zero();
    double segment_s = 0, integrate_s = 0, solve_s = 0;
    double latency_s = 0;  // live

    [[nodiscard]] Time begin() const { return t - from_seconds(duration_s); }
  };
  struct Replay {
    Time first = 0;  // event
    Clock::time_point begin;
  };
  struct Snapshot {
    std::size_t window = 0;
    Time t = 0;
    std::vector<PictureEvent> events;
    std::vector<PictureLine> lines;
  };

  void publish(const Estimate& estimate);
  [[nodiscard]] std::optional<double> first_good_pose_s() const;
  void take_snapshot(const Estimate& estimate, const Sight& sight);
  void write_trajectories(const Odometry& odometry) const;
  void write_windows() const;
  void write_pictures() const;

  std::filesystem::path dir_;
  Rig rig_;
  double rate_hz_;
  std::vector<NavState> causal_;
  Trajectory causal_camera_;
  mutable std::mutex rows_mutex_;  // the thread that reads asks how far it is
  std::vector<Row> rows_;
  SegmenterCounts counts_;
  EventLog event_log_;
  std::optional<Replay> replay_;
  std::vector<Snapshot> snapshots_;
  std::size_t snapshot_every_ = 1;
  Clock::time_point begin_ = Clock::now();
};

}  // namespace idol
