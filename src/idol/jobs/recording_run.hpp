// A recording from its first event to its results: what `idol run` and Python's idol.run do.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "idol/io/event_monitor.hpp"
#include "idol/io/reader.hpp"
#include "idol/jobs/gyro_image_check.hpp"
#include "idol/jobs/run_recorder.hpp"
#include "idol/odometry/odometry.hpp"
#include "idol/view/sight.hpp"

namespace idol {

struct RunRequest {
  std::filesystem::path sequence;
  std::filesystem::path rig_path, imu_rig_path;  ///< as load_rig takes them
  std::optional<Rig> rig;                        ///< instead of any file
  std::filesystem::path out;                     ///< folder for the results; empty: nothing is written
  std::string preset = "realtime";               ///< what `options` began as, for stats.json
  Options options;
  double from_s = 0, to_s = 1e30;  ///< seconds from the recording's first stamp
  StreamChoice choice;
  double rate_hz = 0;  ///< of the trajectories; 0: one pose a window
  bool live = false;   ///< in the recording's own time
};

/// Each may be empty.
struct RunListeners {
  struct Progress {
    double share = 0, data_s = 0;  ///< of the input in [0, 1]; estimated so far [s]
    std::int64_t events = 0;
    int lines = 0;
  };
  std::function<void(const Estimate&)> estimate;             ///< as Odometry::on_estimate says
  std::function<void(const Estimate&, const Sight&)> sight;  ///< the same, with what there is to see of it
  std::function<void(const Progress&)> progress;  ///< every millisecond of data, in the thread that runs
  std::function<bool()> interrupted;              ///< asked as often; true ends the run
};

class RecordingRun {
 public:
  /// Opens recording and rig, looks at the recording's beginning, and clears `out` of the results of an
  /// earlier run. Throws DataError, also where that beginning shows that the run is impossible, and
  /// UsageError.
  RecordingRun(RunRequest request, RunListeners listeners);

  enum class End { kDone, kBadData, kInterrupted, kNothingTracked };
  struct Outcome {
    End end = End::kDone;
    std::string message;  ///< why it is not kDone
  };
  /// Once: all events through the odometry, then the results into `out`. Damage in the recording ends the
  /// reading, not the run: what came before it is estimated. Throws DataError when the disk refuses.
  Outcome go();

  [[nodiscard]] const Rig& rig() const { return rig_; }
  [[nodiscard]] const Odometry& odometry() const { return odometry_; }
  [[nodiscard]] const RunRecorder& recorder() const { return recorder_; }
  /// What was found before the run began.
  [[nodiscard]] const Diagnostics& checks() const { return checks_; }
  /// After go(): all that was odd.
  [[nodiscard]] const Diagnostics& diagnostics() const { return summary_.diagnostics; }
  /// After go(): the text of stats.json.
  [[nodiscard]] std::string stats_json() const { return recorder_.stats_json(odometry_, summary_); }
  /// After go(), with `out` and ground truth: one line of figures; else empty.
  [[nodiscard]] const std::string& figures() const { return figures_; }

 private:
  [[nodiscard]] bool interrupted() const { return listeners_.interrupted && listeners_.interrupted(); }
  void prepare_output();
  Outcome feed();
  void push(const Packet& packet);
  void push(const ImuSample& sample);
  void check_sensor();
  [[nodiscard]] Outcome explain_no_estimate() const;
  void write_backdrops();

  RunRequest request_;
  RunListeners listeners_;
  RunRecorder::Summary summary_;
  Rig rig_;
  Diagnostics checks_;
  std::unique_ptr<Reader> reader_;
  RunRecorder recorder_;
  EventMonitor monitor_;
  std::string figures_;
  UndistortMap undistort_;
  GyroImageCheck gyro_check_;
  Odometry odometry_;  // last: its thread calls the listeners and the recorder
};

}  // namespace idol
