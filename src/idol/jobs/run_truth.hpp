// A run beside ground truth.
#pragma once

#include <filesystem>
#include <string>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/recording.hpp"

namespace idol {

/// Where the recording has ground truth: writes evaluation.json and evaluation_causal.json (of both
/// trajectories of the camera, or of the IMU if that is what the truth is of, as `idol evaluate --json`
/// would) and groundtruth_camera.txt (the part of the estimate's time, for the report; truth of the IMU is
/// taken to the camera and its clock by `rig`) into `out`; returns one line of figures of protocol `full`,
/// empty without truth. Truth that cannot be used is counted in `diagnostics`. Throws DataError only when the
/// disk refuses.
std::string judge_against_truth(const std::filesystem::path& sequence, const StreamChoice& choice,
                                const Rig& rig, const std::filesystem::path& out, Diagnostics& diagnostics);

}  // namespace idol
