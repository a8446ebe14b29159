// Where the two trajectories of an evaluation come from.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "idol/base/types.hpp"

namespace idol {

/// Ground truth of a trajectory file (TUM) or of a recording of any format.
struct GroundTruth {
  Trajectory trajectory;
  std::string name;  ///< the file it came from, for messages
  bool of_imu = false;
  std::int64_t lost = 0;  ///< poses that the capture had lost, left out
};

/// Throws DataError if there is none.
GroundTruth load_groundtruth(const std::filesystem::path& path);

/// The trajectory file to judge: `path`, or within a run's folder that of the body which the truth is of.
std::filesystem::path estimate_file(const std::filesystem::path& path, const GroundTruth& truth);

/// Throws DataError if it cannot be read or holds no pose.
Trajectory load_estimate(const std::filesystem::path& file);

}  // namespace idol
