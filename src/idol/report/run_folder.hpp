// What a run left in its folder, as far as it can be read.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/report/event_log.hpp"
#include "idol/report/frames.hpp"

namespace idol {

/// The files that a run writes into its folder; besides, the folders `pictures` and `frames`.
inline constexpr const char* kRunFiles[] = {"trajectory_camera.txt",
                                            "trajectory_imu.txt",
                                            "trajectory_camera_causal.txt",
                                            "trajectory_imu_causal.txt",
                                            "states.csv",
                                            "states_causal.csv",
                                            "events_shown.bin",
                                            "lines.csv",
                                            "lines.ply",
                                            "windows.csv",
                                            "stats.json",
                                            "config.yaml",
                                            "rig.yaml",
                                            "rig_refined.yaml",
                                            "groundtruth_camera.txt",
                                            "evaluation.json",
                                            "evaluation_causal.json",
                                            "report.html"};

/// Columns of a CSV file by the name in its header. Entries that are not numbers are NaN.
struct CsvColumns {
  std::vector<Time> t;  ///< the column `t`
  std::map<std::string, std::vector<double>> columns;

  /// The column, or nullptr.
  [[nodiscard]] const std::vector<double>* find(const std::string& name) const;
};

/// Everything is empty where its file is missing or damaged; `notes` then says so. All stamps are by the
/// IMU's clock.
struct RunFolder {
  Trajectory camera, imu, camera_causal, imu_causal;
  Trajectory groundtruth;  ///< of the camera
  std::vector<NavState> states, states_causal;
  std::vector<Line> lines;
  CsvColumns windows;
  std::optional<Camera> camera_model;  ///< of rig.yaml
  std::optional<Rig> refined;          ///< as the run found it in the end
  std::string stats_json, evaluation_json, config_yaml, rig_yaml;
  std::vector<FrameFile> frames;    ///< undistorted
  std::vector<ShownWindow> events;  ///< what is shown of each window's events
  std::vector<std::string> notes;
};

/// Throws DataError when there is no such folder, or nothing of a run in it.
RunFolder read_run_folder(const std::filesystem::path& dir);

/// The earliest stamp of the estimate: where its time axes begin. Nothing if there is no trajectory, state,
/// window or line.
std::optional<Time> first_stamp(const RunFolder& run);

/// A whole file as bytes. Throws DataError.
std::string read_file(const std::filesystem::path& path);

}  // namespace idol
