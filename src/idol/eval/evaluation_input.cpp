#include "idol/eval/evaluation_input.hpp"

#include <fmt/format.h>

#include <utility>

#include "idol/base/diagnostics.hpp"
#include "idol/io/recording.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {

namespace fs = std::filesystem;

Trajectory load_estimate(const fs::path& file) {
  Trajectory trajectory = read_trajectory(file);
  if (trajectory.empty())
    throw DataError(
        fmt::format("{}: holds no pose; rows 't tx ty tz qx qy qz qw' are expected", file.string()));
  return trajectory;
}

GroundTruth load_groundtruth(const fs::path& path) {
  if (!holds_recording(path)) {
    TruthFile truth = read_truth(path);
    return {std::move(truth.poses), path.string(), false, truth.lost};
  }
  const auto recording = open_recording(path);
  auto trajectory = recording->groundtruth();
  if (!trajectory) throw DataError(fmt::format("{}: this recording has no ground truth", path.string()));
  const auto file = path / "groundtruth.txt";
  return {*trajectory, fs::exists(file) ? file.string() : path.string(), recording->truth_of_imu(),
          recording->lost_poses()};
}

fs::path estimate_file(const fs::path& path, const GroundTruth& truth) {
  if (!fs::is_directory(path)) return path;
  return path / (truth.of_imu ? "trajectory_imu.txt" : "trajectory_camera.txt");
}

}  // namespace idol
