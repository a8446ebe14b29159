// The named ways of judging a trajectory, so that figures can be laid beside published ones.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "idol/eval/metrics.hpp"

namespace idol {

/// A way of computing absolute errors.
struct Protocol {
  std::string name;
  AlignmentKind kind = AlignmentKind::kNone;
  PoseSelection poses;            ///< what the alignment uses
  std::optional<double> until_s;  ///< errors over this long from the estimate's start; unset: all
};

/// The protocol of relative errors, which has no alignment.
inline constexpr const char* kSegmentsProtocol = "segments";
/// Shares of the ground truth's length that relative errors are computed over [%].
inline constexpr std::array<int, 5> kSegmentPercents = {10, 20, 30, 40, 50};
/// A ground truth smaller than this over the aligned poses hardly determines the yaw [m].
inline constexpr double kStillSpan = 0.05;

/// The absolute protocols: idol, uslam, hku, full, sim3.
const std::vector<Protocol>& named_protocols();

/// All names that --protocol knows, `segments` included, in the order of the table.
std::vector<std::string> protocol_names();

struct EvaluationOptions {
  std::vector<std::string> protocols;  ///< names; none and no `custom`: all
  std::optional<Protocol> custom;      ///< free alignment; its scale is that of the segments too
  std::optional<double> until_s;       ///< judge only this long from the estimate's start
  bool interpolate = false;            ///< interpolate ground truth instead of taking the nearest pose
};

/// The figures of one alignment.
struct AbsoluteFigures {
  double scale = 1.0;
  Stats translation_m;
  Stats rotation_deg;
  Stats yaw_deg;
  Stats tilt_deg;
  double mpe_percent = 0;    ///< mean translation error / length of ground truth; NaN where that is 0
  double mye_deg_per_m = 0;  ///< mean yaw error / length of ground truth
};

struct ProtocolResult {
  Protocol protocol;
  std::size_t poses = 0;  ///< matched poses judged
  double distance_m = 0;  ///< length of ground truth between the first and the last of them
  Alignment alignment;
  AbsoluteFigures figures;
  std::optional<AbsoluteFigures> yaw_from_rotations;  ///< `idol` after a still start
  std::vector<std::string> notes;
};

struct SegmentResult {
  int percent = 0;
  double length_m = 0;
  std::size_t samples = 0;
  Stats translation_m;
  Stats translation_percent;
  Stats rotation_deg;
  Stats rotation_deg_per_m;
  Stats yaw_deg;
  Stats tilt_deg;
};

struct Evaluation {
  std::size_t estimate_poses = 0;
  std::size_t matched = 0;
  double coverage = 0;       ///< share of the recording's (ground truth's) time that the estimate covers
  double distance_m = 0;     ///< length of ground truth between the first and the last matched stamp
  double groundtruth_m = 0;  ///< length of the whole ground truth
  std::vector<ProtocolResult> protocols;
  double segment_scale = 1.0;
  std::vector<SegmentResult> segments;  ///< empty unless asked for
  /// Protocols that could not be computed, with the reason; only when all were run without being named.
  std::vector<std::pair<std::string, std::string>> skipped;
};

/// Judges an estimate. Throws UsageError for an unknown protocol, DataError when nothing matches or a
/// protocol asked for by name lacks poses.
Evaluation evaluate(const Trajectory& estimate, const Trajectory& groundtruth,
                    const EvaluationOptions& options);

}  // namespace idol
