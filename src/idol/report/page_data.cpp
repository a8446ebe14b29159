#include "idol/report/page_data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <optional>

#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/eval/evaluation_output.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/curves.hpp"
#include "idol/report/hints.hpp"
#include "idol/report/page_json.hpp"

namespace idol {
namespace {

/// The page must stay light enough to mail: limits on what is drawn, told on the page where they bite.
constexpr std::size_t kMaxPoses = 4000;
constexpr std::size_t kMaxLines = 20000;
constexpr std::uintmax_t kMaxFrameBytes = 5 << 20;
Json numbers(const std::vector<double>& values, double (*round)(double)) {
  Json out = Json::array();
  for (double v : values) out.push_back(round(v));
  return out;
}

Json trajectory_json(const Trajectory& trajectory, const std::string& name, Time zero,
                     std::vector<std::string>& notes) {
  const std::size_t step = (trajectory.size() + kMaxPoses - 1) / kMaxPoses;
  Trajectory drawn;
  for (std::size_t i = 0; i < trajectory.size(); ++i)
    if (i % step == 0 || i + 1 == trajectory.size()) drawn.push_back(trajectory[i]);
  if (step > 1)
    notes.push_back(fmt::format("The 3D view draws one in {} of the {} poses of the {} trajectory.", step,
                                trajectory.size(), name));
  return path_json(drawn, zero);
}

/// The lines that are drawn.
std::vector<Line> chosen_lines(const RunFolder& run, std::vector<std::string>& notes) {
  std::vector<Line> lines = run.lines;
  if (lines.size() > kMaxLines) {
    std::stable_sort(lines.begin(), lines.end(),
                     [](const Line& a, const Line& b) { return a.windows > b.windows; });
    lines.resize(kMaxLines);
    notes.push_back(fmt::format("The 3D view draws the {} lines seen in most windows, of {}.", kMaxLines,
                                run.lines.size()));
  }
  return lines;
}

Json panels_json(const std::vector<Panel>& panels) {
  Json out = Json::array();
  for (const Panel& panel : panels) {
    Json series = Json::array();
    for (const Series& s : panel.series) {
      series.push_back({{"name", s.name},
                        {"colour", s.colour},
                        {"style", s.style},
                        {"t", numbers(s.t, rounded_seconds)},
                        {"y", numbers(s.y, rounded)}});
      if (!s.band.empty()) series.back()["band"] = numbers(s.band, rounded);
    }
    out.push_back({{"group", panel.group}, {"title", panel.title}, {"unit", panel.unit}, {"series", series}});
  }
  return out;
}

/// How long each line was tracked, in at most 25 bins of a width that reads well.
Json track_lengths_json(const std::vector<Line>& lines) {
  if (lines.empty()) return nullptr;
  double longest = 0;
  for (const Line& line : lines) longest = std::max(longest, seconds_between(line.first, line.last));
  double width = 0.001;
  for (int i = 0; longest / width >= 25; ++i) width *= i % 3 == 1 ? 2.5 : 2.0;
  std::vector<int> counts(static_cast<std::size_t>(longest / width) + 1);
  for (const Line& line : lines)
    ++counts[static_cast<std::size_t>(std::max(0.0, seconds_between(line.first, line.last)) / width)];
  return {{"width", width}, {"counts", counts}};
}

/// Where the events of each window lie in the packed bytes, which are appended to `packed`.
Json events_json(const RunFolder& run, Time zero, std::string& packed, std::vector<std::string>& notes) {
  Json out;
  for (const char* column : {"t", "own", "around", "shown", "offset", "size"}) out[column] = Json::array();
  for (const ShownWindow& window : run.events) {
    out["t"].push_back(rounded_seconds(seconds_between(zero, window.t)));
    out["own"].push_back(window.own);
    out["around"].push_back(window.around);
    out["shown"].push_back(window.shown);
    out["offset"].push_back(packed.size());
    out["size"].push_back(window.packed.size());
    packed += window.packed;
    packed.append((3 - packed.size() % 3) % 3, '\0');
  }
  if (!run.events.empty() && run.events.size() < run.windows.t.size())
    notes.push_back(fmt::format("The event view has {} of the {} windows: a long run is thinned.",
                                run.events.size(), run.windows.t.size()));
  return out;
}

/// An evenly spread choice that fits, as data URIs.
Json frames_json(const RunFolder& run, Time zero, std::vector<std::string>& notes) {
  Json out{{"t", Json::array()}, {"src", Json::array()}};
  std::uintmax_t all = 0;
  std::error_code gone;
  for (const FrameFile& frame : run.frames) all += std::filesystem::file_size(frame.path, gone);
  const std::size_t step = static_cast<std::size_t>(all / kMaxFrameBytes) + 1;
  for (std::size_t i = 0; i < run.frames.size(); i += step) {
    try {
      out["src"].push_back("data:image/png;base64," + base64(read_file(run.frames[i].path)));
      out["t"].push_back(rounded_seconds(seconds_between(zero, run.frames[i].t)));
    } catch (const DataError& e) {
      notes.emplace_back(e.what());
    }
  }
  return out;
}

Json parsed(const std::string& text, const char* name, std::vector<std::string>& notes) {
  if (text.empty()) return nullptr;
  Json json = Json::parse(text, nullptr, false);
  if (json.is_object()) return json;
  notes.push_back(fmt::format("{} cannot be used: it is not a JSON object.", name));
  return nullptr;
}

/// Smallest, lower quartile, median, upper quartile and largest.
Json five_numbers(std::vector<double> values) {
  if (values.empty()) return nullptr;
  std::sort(values.begin(), values.end());
  Json out = Json::array();
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const double at = share * static_cast<double>(values.size() - 1);
    const auto low = static_cast<std::size_t>(at), high = std::min(low + 1, values.size() - 1);
    const double part = at - static_cast<double>(low);
    out.push_back(rounded((1 - part) * values[low] + part * values[high]));
  }
  return out;
}

/// The errors of protocol `segments` as boxes.
Json boxes_json(const Trajectory& estimate, const Trajectory& groundtruth) {
  const MatchedPoses matched = match_nearest(estimate, groundtruth);
  const double length = path_length(groundtruth);
  Json out = Json::array();
  for (const int percent : kSegmentPercents) {
    const RelativeErrors errors = relative_errors(matched, segment_length(percent, length), 1.0);
    if (errors.translation_m.empty()) continue;
    out.push_back({{"percent", percent},
                   {"length_m", errors.length_m},
                   {"samples", errors.translation_m.size()},
                   {"translation_percent", five_numbers(errors.translation_percent)},
                   {"rotation_deg", five_numbers(errors.rotation_deg)}});
  }
  return out;
}

/// Of the smoothed trajectory (evaluation.json, or computed) and of the causal one.
Json evaluations_json(const RunFolder& run, std::vector<std::string>& notes) {
  const Json given = parsed(run.evaluation_json, "evaluation.json", notes);
  Json out = Json::array();
  for (const auto& [title, trajectory] :
       {std::pair{"Smoothed trajectory", &run.camera}, std::pair{"Causal trajectory", &run.camera_causal}}) {
    Json judged{{"title", title}, {"data", nullptr}, {"boxes", Json::array()}};
    if (trajectory == &run.camera) judged["data"] = given;
    try {
      if (!trajectory->empty() && !run.groundtruth.empty()) {
        if (judged["data"].is_null())
          judged["data"] = Json::parse(evaluation_json(evaluate(*trajectory, run.groundtruth, {})));
        judged["boxes"] = boxes_json(*trajectory, run.groundtruth);
      }
    } catch (const DataError& e) {
      notes.push_back(fmt::format("{} not evaluated: {}.", title, e.what()));
    }
    if (!judged["data"].is_null()) out.push_back(judged);
  }
  return out;
}

/// What turns the world of the run into that of the ground truth: a matrix by rows, and a shift.
Json alignment_json(const AlignedTruth& truth) {
  if (truth.matched.size() == 0) return nullptr;
  const Mat3& R = truth.alignment.R;
  const Vec3& t = truth.alignment.t;
  return {{"R", {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)}},
          {"t", {t.x(), t.y(), t.z()}}};
}

}  // namespace

PageData page_data(const RunFolder& run) {
  PageData page;
  std::vector<std::string> notes = run.notes;
  const std::optional<Time> first = first_stamp(run);
  const Time zero = first.value_or(0);
  const AlignedTruth truth = align_truth(run.camera, run.groundtruth);
  const AlignedTruth causal_truth = align_truth(run.camera_causal, run.groundtruth);
  if (!run.groundtruth.empty() && !run.camera.empty() && truth.matched.size() == 0)
    notes.emplace_back("No pose of the estimate has a ground-truth pose within 20 ms: no comparison.");
  const std::vector<Panel> panels = make_panels(run, truth, causal_truth, zero);
  Json data;
  data["zero"] = first ? Json(format_stamp(zero)) : Json(nullptr);
  data["stats"] = parsed(run.stats_json, "stats.json", notes);
  data["hints"] = run_hints(run, panels, zero);
  data["evaluations"] = evaluations_json(run, notes);
  data["smoothed"] = trajectory_json(run.camera, "smoothed", zero, notes);
  data["causal"] = trajectory_json(run.camera_causal, "causal", zero, notes);
  data["truth"] = trajectory_json(truth.camera, "ground-truth", zero, notes);
  data["alignment"] = alignment_json(truth);
  data["camera"] =
      run.camera_model && run.camera_model->width > 0 ? camera_json(*run.camera_model) : Json(nullptr);
  data["palette"] = palette_json();
  data["lines"] = lines_json(chosen_lines(run, notes), zero);
  data["panels"] = panels_json(panels);
  data["trackLengths"] = track_lengths_json(run.lines);
  data["events"] = events_json(run, zero, page.events, notes);
  data["frames"] = frames_json(run, zero, notes);
  data["files"] = Json::array();
  for (const auto& [name, text] :
       {std::pair{"config.yaml", &run.config_yaml}, std::pair{"rig.yaml", &run.rig_yaml}})
    if (!text->empty()) data["files"].push_back({{"name", name}, {"text", *text}});
  data["notes"] = notes;
  page.json = safe_text(data);
  return page;
}

}  // namespace idol
