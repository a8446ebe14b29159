#include "idol/eval/evaluation_output.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

namespace idol {
namespace {

using Json = nlohmann::ordered_json;

/// A figure for the table; "-" where there is none.
std::string figure(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : "-";
}

void append_row(std::string& text, const std::string& name, const ProtocolResult& result,
                const AbsoluteFigures& f) {
  const std::string how =
      fmt::format("{}, {}", alignment_name(result.protocol.kind), result.protocol.poses.describe());
  fmt::format_to(std::back_inserter(text),
                 "{:<8} {:<18} {:>6} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8} {:>9} {:>9}\n", name,
                 result.protocol.kind == AlignmentKind::kNone ? "none" : how, result.poses,
                 figure(f.translation_m.rmse, 4), figure(f.translation_m.median, 4),
                 figure(f.translation_m.max, 4), figure(f.rotation_deg.rmse, 3), figure(f.yaw_deg.rmse, 3),
                 figure(f.mpe_percent, 3), figure(f.mye_deg_per_m, 4), figure(f.scale, 5));
}

void append_absolute(std::string& text, const Evaluation& evaluation) {
  if (evaluation.protocols.empty()) return;
  fmt::format_to(std::back_inserter(text),
                 "\n{:<8} {:<18} {:>6} {:>9} {:>9} {:>9} {:>8} {:>8} {:>8} {:>9} {:>9}\n", "protocol",
                 "alignment", "poses", "RMSE m", "median m", "max m", "RMSE deg", "yaw deg", "MPE %",
                 "MYE deg/m", "scale");
  for (const ProtocolResult& result : evaluation.protocols) {
    append_row(text, result.protocol.name, result, result.figures);
    if (result.yaw_from_rotations)
      append_row(text, result.protocol.name + " *", result, *result.yaw_from_rotations);
  }
}

void append_segments(std::string& text, const Evaluation& evaluation) {
  if (evaluation.segments.empty()) return;
  fmt::format_to(
      std::back_inserter(text),
      "\nsegments (relative errors{})\n{:>5} {:>9} {:>8} {:>9} {:>9} {:>9} {:>10} {:>9} {:>9} {:>9}\n",
      evaluation.segment_scale == 1.0 ? "" : fmt::format(", scale {:.5f}", evaluation.segment_scale), "%",
      "length m", "samples", "median m", "RMSE m", "median %", "median deg", "deg/m", "yaw deg", "tilt deg");
  for (const SegmentResult& s : evaluation.segments)
    fmt::format_to(
        std::back_inserter(text), "{:>5} {:>9.2f} {:>8} {:>9} {:>9} {:>9} {:>10} {:>9} {:>9} {:>9}\n",
        s.percent, s.length_m, s.samples, figure(s.translation_m.median, 4), figure(s.translation_m.rmse, 4),
        figure(s.translation_percent.median, 3), figure(s.rotation_deg.median, 3),
        figure(s.rotation_deg_per_m.median, 4), figure(s.yaw_deg.median, 3), figure(s.tilt_deg.median, 3));
}

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json stats_json(const Stats& s) {
  return {{"rmse", number(s.rmse)}, {"mean", number(s.mean)}, {"median", number(s.median)},
          {"std", number(s.std)},   {"min", number(s.min)},   {"max", number(s.max)}};
}

Json figures_json(const AbsoluteFigures& f) {
  return {{"scale", number(f.scale)},
          {"translation_m", stats_json(f.translation_m)},
          {"rotation_deg", stats_json(f.rotation_deg)},
          {"yaw_deg", stats_json(f.yaw_deg)},
          {"mpe_percent", number(f.mpe_percent)},
          {"mye_deg_per_m", number(f.mye_deg_per_m)},
          {"tilt_deg", stats_json(f.tilt_deg)}};
}

Json protocol_json(const ProtocolResult& result) {
  Json json = figures_json(result.figures);
  json["poses"] = result.poses;
  json["distance_m"] = number(result.distance_m);
  json["alignment"] = {{"kind", alignment_name(result.protocol.kind)},
                       {"on", result.protocol.poses.describe()},
                       {"poses", result.alignment.poses},
                       {"span_m", number(result.alignment.span_m)}};
  if (result.yaw_from_rotations) json["yaw_from_rotations"] = figures_json(*result.yaw_from_rotations);
  if (!result.notes.empty()) json["notes"] = result.notes;
  return json;
}

Json segment_json(const SegmentResult& s) {
  return {{"length_m", number(s.length_m)},
          {"samples", s.samples},
          {"translation_m", stats_json(s.translation_m)},
          {"translation_percent", stats_json(s.translation_percent)},
          {"rotation_deg", stats_json(s.rotation_deg)},
          {"yaw_deg", stats_json(s.yaw_deg)},
          {"rotation_deg_per_m", stats_json(s.rotation_deg_per_m)},
          {"tilt_deg", stats_json(s.tilt_deg)}};
}

}  // namespace

std::string evaluation_text(const Evaluation& evaluation) {
  std::string text = fmt::format(
      "matched {} of {} poses, coverage {:.1f} % of the time, {:.3f} m of ground truth ({:.3f} m in all)\n",
      evaluation.matched, evaluation.estimate_poses, 100 * evaluation.coverage, evaluation.distance_m,
      evaluation.groundtruth_m);
  append_absolute(text, evaluation);
  append_segments(text, evaluation);
  std::string notes;
  for (const ProtocolResult& result : evaluation.protocols)
    for (const std::string& note : result.notes)
      notes += fmt::format("{}: {}\n", result.protocol.name + (result.yaw_from_rotations ? " *" : ""), note);
  for (const auto& [name, reason] : evaluation.skipped)
    notes += fmt::format("{}: not computed, {}\n", name, reason);
  return notes.empty() ? text : text + "\n" + notes;
}

std::string evaluation_json(const Evaluation& evaluation) {
  Json protocols = Json::object();
  for (const ProtocolResult& result : evaluation.protocols)
    protocols[result.protocol.name] = protocol_json(result);
  if (!evaluation.segments.empty()) {
    Json& segments = protocols[kSegmentsProtocol];
    for (const SegmentResult& s : evaluation.segments) segments[std::to_string(s.percent)] = segment_json(s);
  }
  Json json = {{"matched", evaluation.matched},
               {"coverage", number(evaluation.coverage)},
               {"distance_m", number(evaluation.distance_m)},
               {"protocols", protocols},
               {"estimate_poses", evaluation.estimate_poses},
               {"groundtruth_m", number(evaluation.groundtruth_m)}};
  if (!evaluation.skipped.empty()) {
    Json& skipped = json["skipped"];
    for (const auto& [name, reason] : evaluation.skipped) skipped[name] = reason;
  }
  return json.dump(2) + "\n";
}

}  // namespace idol
