#include "idol/jobs/run_truth.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "idol/eval/evaluation_output.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {
namespace {

Trajectory part_of(const Trajectory& truth, Time from, Time to) {
  Trajectory part;
  for (const auto& pose : truth)
    if (pose.t >= from && pose.t <= to) part.push_back(pose);
  return part;
}

std::string full_figures(const Evaluation& evaluation) {
  for (const ProtocolResult& result : evaluation.protocols) {
    if (result.protocol.name != "full") continue;
    const AbsoluteFigures& f = result.figures;
    return fmt::format(
        "ground truth, protocol full: translation RMSE {:.4f} m (MPE {:.3f} % of {:.2f} m), "
        "rotation RMSE {:.3f} deg, {} poses",
        f.translation_m.rmse, f.mpe_percent, result.distance_m, f.rotation_deg.rmse, result.poses);
  }
  return {};
}

}  // namespace

std::string judge_against_truth(const std::filesystem::path& sequence, const StreamChoice& choice,
                                const Rig& rig, const std::filesystem::path& out, Diagnostics& diagnostics) {
  std::optional<Trajectory> truth;
  bool of_imu = false;
  try {
    const auto recording = open_recording(sequence, choice);
    truth = recording->groundtruth();
    if (!truth) return {};
    of_imu = recording->truth_of_imu();
    if (const auto lost = recording->lost_poses(); lost > 0)
      diagnostics.warn("lost_truth",
                       fmt::format("{}: poses of the ground truth that its capture had lost are left out",
                                   sequence.string()),
                       lost);
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    diagnostics.warn("bad_groundtruth", fmt::format("{}; the run is not compared with it", e.what()));
    return {};
  }
  const std::string judged = of_imu ? "trajectory_imu" : "trajectory_camera";
  // Read back, so that the figures are those of the files to the last digit.
  const Trajectory estimate = read_trajectory(out / (judged + ".txt"));
  const auto judge = [&](const Trajectory& trajectory, const char* file) -> std::optional<Evaluation> {
    try {
      const Evaluation evaluation = evaluate(trajectory, *truth, {});
      write_text_file(out / file, evaluation_json(evaluation));
      return evaluation;
    } catch (const DataError& e) {
      diagnostics.warn("bad_groundtruth", fmt::format("{}: ground truth: {}; the run is not compared with it",
                                                      sequence.string(), e.what()));
      return std::nullopt;
    }
  };
  const auto smoothed = judge(estimate, "evaluation.json");
  if (!smoothed) return {};
  try {
    judge(read_trajectory(out / (judged + "_causal.txt")), "evaluation_causal.json");
  } catch (const DataError&) {
    // Over before a pose was published.
  }
  Trajectory shown = part_of(*truth, estimate.front().t, estimate.back().t);
  if (of_imu)
    for (StampedPose& pose : shown) pose = {pose.t - from_seconds(rig.time_offset_s), pose.T * rig.T_i_c};
  // Positions alone make no poses to be shown.
  if (std::all_of(shown.begin(), shown.end(),
                  [](const StampedPose& p) { return p.T.q.coeffs().allFinite(); }))
    write_trajectory(out / "groundtruth_camera.txt", shown);
  return full_figures(*smoothed);
}

}  // namespace idol
