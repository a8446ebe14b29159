#include "idol/eval/protocols.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

AbsoluteFigures figures_of(const MatchedPoses& pairs, const Similarity& T, double distance_m) {
  const AbsoluteErrors errors = absolute_errors(pairs, T);
  AbsoluteFigures figures{.scale = T.scale,
                          .translation_m = statistics(errors.translation_m),
                          .rotation_deg = statistics(errors.rotation_deg),
                          .yaw_deg = statistics(errors.yaw_deg),
                          .tilt_deg = statistics(errors.tilt_deg)};
  const double per_metre = distance_m > 0 ? 1.0 / distance_m : std::numeric_limits<double>::quiet_NaN();
  figures.mpe_percent = 100.0 * figures.translation_m.mean * per_metre;
  figures.mye_deg_per_m = figures.yaw_deg.mean * per_metre;
  return figures;
}

/// What the reader of the figures has to know about the alignment.
std::vector<std::string> alignment_notes(const Protocol& protocol, const Alignment& alignment,
                                         double estimate_s) {
  std::vector<std::string> notes;
  if (protocol.poses.first && alignment.poses < *protocol.poses.first)
    notes.push_back(
        fmt::format("only {} of the {} poses to align on exist", alignment.poses, *protocol.poses.first));
  if (protocol.poses.seconds && estimate_s < protocol.poses.seconds->second)
    notes.push_back(fmt::format("the estimate ends after {:.3f} s, before the {:g} s to align on do",
                                estimate_s, protocol.poses.seconds->second));
  if (alignment.from_rotations)
    notes.push_back(
        alignment.poses == 1
            ? "aligned on one pose"
            : "the positions aligned on lie on one point or line: the orientations complete the rotation");
  return notes;
}

ProtocolResult run_protocol(const Protocol& protocol, const MatchedPoses& pairs, const Trajectory& estimate,
                            const Trajectory& groundtruth) {
  const Time start = estimate.front().t;
  const double estimate_s = seconds_between(start, estimate.back().t);
  ProtocolResult result;
  result.protocol = protocol;
  MatchedPoses judged = pairs;
  if (protocol.until_s) judged = select_poses(pairs, start, {{}, std::pair{0.0, *protocol.until_s}});
  const MatchedPoses used = select_poses(pairs, start, protocol.poses);
  if (used.size() == 0 || judged.size() == 0)
    throw DataError(
        fmt::format("protocol {} needs at least 1 matched pose ({}) to align on, found 0; "
                    "the estimate lasts {:.3f} s with {} matched poses",
                    protocol.name, protocol.poses.describe(), estimate_s, pairs.size()));
  result.poses = judged.size();
  result.distance_m = matched_length(judged, groundtruth);
  result.alignment = align(used, protocol.kind);
  result.figures = figures_of(judged, result.alignment.T, result.distance_m);
  result.notes = alignment_notes(protocol, result.alignment, estimate_s);
  if (result.distance_m == 0) result.notes.push_back("ground truth does not move: no MPE, no MYE");
  if (protocol.name == "idol" && result.alignment.span_m < kStillSpan) {
    result.yaw_from_rotations = figures_of(judged, align_yaw_from_rotations(used).T, result.distance_m);
    result.notes.push_back(fmt::format(
        "the {} poses aligned on span {:.1f} cm, less than {:g} cm: their positions hardly determine "
        "the yaw; figures with the yaw from the rotations beside",
        used.size(), 100 * result.alignment.span_m, 100 * kStillSpan));
  }
  return result;
}

SegmentResult run_segment(const MatchedPoses& pairs, int percent, double groundtruth_m, double scale) {
  const RelativeErrors errors = relative_errors(pairs, segment_length(percent, groundtruth_m), scale);
  return {.percent = percent,
          .length_m = errors.length_m,
          .samples = errors.translation_m.size(),
          .translation_m = statistics(errors.translation_m),
          .translation_percent = statistics(errors.translation_percent),
          .rotation_deg = statistics(errors.rotation_deg),
          .rotation_deg_per_m = statistics(errors.rotation_deg_per_m),
          .yaw_deg = statistics(errors.yaw_deg),
          .tilt_deg = statistics(errors.tilt_deg)};
}

void check_names(const std::vector<std::string>& names) {
  const std::vector<std::string> known = protocol_names();
  for (const std::string& name : names)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw UsageError(fmt::format("unknown protocol '{}': choose from {}", name, fmt::join(known, ", ")));
}

Trajectory cut(const Trajectory& estimate, std::optional<double> until_s) {
  if (!until_s || estimate.empty()) return estimate;
  Trajectory kept;
  for (const StampedPose& pose : estimate)
    if (seconds_between(estimate.front().t, pose.t) <= *until_s) kept.push_back(pose);
  return kept;
}

void check_matched(const MatchedPoses& pairs, const Trajectory& estimate, const Trajectory& groundtruth) {
  // Two or fewer align with anything.
  constexpr std::size_t kFewest = 3;
  if (pairs.size() >= std::min({kFewest, estimate.size(), groundtruth.size()}) && pairs.size() > 0) return;
  const auto range = [](const Trajectory& t) {
    return fmt::format("{} poses from {:.3f} to {:.3f} s", t.size(), stamp_seconds(t.front().t),
                       stamp_seconds(t.back().t));
  };
  throw DataError(fmt::format(
      "{} estimate pose{} ground truth at {} time: the estimate has {}, the ground truth {}; give files of "
      "the "
      "same recording with stamps of the same clock",
      pairs.size() == 0 ? "no" : fmt::format("only {}", pairs.size()), pairs.size() == 2 ? "s have" : " has",
      pairs.size() == 2 ? "their" : "its", range(estimate), range(groundtruth)));
}

/// The protocols to run, in the table's order; `custom` first.
std::vector<Protocol> chosen_protocols(const EvaluationOptions& options) {
  std::vector<Protocol> chosen;
  if (options.custom) chosen.push_back(*options.custom);
  const auto asked = [&](const std::string& name) {
    return std::find(options.protocols.begin(), options.protocols.end(), name) != options.protocols.end();
  };
  const bool all = options.protocols.empty() && !options.custom;
  for (const Protocol& protocol : named_protocols()) {
    // sim3 hides the scale error, so it is never shown alone.
    const bool company = protocol.name == "full" && asked("sim3");
    if (all || asked(protocol.name) || company) chosen.push_back(protocol);
  }
  return chosen;
}

bool wants_segments(const EvaluationOptions& options) {
  return options.protocols.empty() || std::find(options.protocols.begin(), options.protocols.end(),
                                                kSegmentsProtocol) != options.protocols.end();
}

}  // namespace

const std::vector<Protocol>& named_protocols() {
  static const std::vector<Protocol> protocols = {
      {"idol", AlignmentKind::kPosYaw, {.first = 50, .seconds = {}}, 40.0},
      {"uslam", AlignmentKind::kSe3, {.first = {}, .seconds = std::pair{3.0, 8.0}}, {}},
      {"hku", AlignmentKind::kSe3, {.first = {}, .seconds = std::pair{0.0, 5.0}}, {}},
      {"full", AlignmentKind::kPosYaw, {}, {}},
      {"sim3", AlignmentKind::kSim3, {}, {}},
  };
  return protocols;
}

std::vector<std::string> protocol_names() {
  std::vector<std::string> names;
  for (const Protocol& protocol : named_protocols()) names.push_back(protocol.name);
  names.emplace_back(kSegmentsProtocol);
  return names;
}

Evaluation evaluate(const Trajectory& whole_estimate, const Trajectory& groundtruth,
                    const EvaluationOptions& options) {
  check_names(options.protocols);
  if (whole_estimate.empty()) throw DataError("the estimate has no pose");
  if (groundtruth.empty()) throw DataError("the ground truth has no pose");
  const Trajectory estimate = cut(whole_estimate, options.until_s);
  const MatchedPoses pairs =
      options.interpolate ? match_interpolated(estimate, groundtruth) : match_nearest(estimate, groundtruth);
  check_matched(pairs, estimate, groundtruth);

  Evaluation result;
  result.estimate_poses = estimate.size();
  result.matched = pairs.size();
  Time end = groundtruth.back().t;
  if (options.until_s) end = std::min(end, estimate.front().t + from_seconds(*options.until_s));
  result.coverage = time_coverage(estimate, groundtruth.front().t, end);
  result.distance_m = matched_length(pairs, groundtruth);
  result.groundtruth_m = path_length(groundtruth);

  if (options.custom && options.custom->poses.first.value_or(0) > pairs.size())
    throw DataError(
        fmt::format("an alignment on the first {} poses needs as many matched poses; there are {}",
                    *options.custom->poses.first, pairs.size()));
  const bool all = options.protocols.empty() && !options.custom;
  for (const Protocol& protocol : chosen_protocols(options)) {
    try {
      result.protocols.push_back(run_protocol(protocol, pairs, estimate, groundtruth));
    } catch (const DataError& e) {
      if (!all) throw;
      result.skipped.emplace_back(protocol.name, e.what());
    }
  }
  if (wants_segments(options)) {
    if (options.custom) result.segment_scale = result.protocols.front().alignment.T.scale;
    for (const int percent : kSegmentPercents)
      result.segments.push_back(run_segment(pairs, percent, result.groundtruth_m, result.segment_scale));
  }
  return result;
}

}  // namespace idol
