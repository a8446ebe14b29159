#include "idol/report/page_data.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/eval/evaluation_output.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/curves.hpp"
#include "idol/report/picture.hpp"

namespace idol {
namespace {

using Json = nlohmann::ordered_json;

/// The page must stay light enough to mail: limits on what is drawn, told on the page where they bite.
constexpr std::size_t kMaxPoses = 4000;
constexpr std::size_t kMaxLines = 20000;
constexpr std::size_t kMaxPictures = 24;
constexpr std::size_t kMaxPictureBytes = 16 << 20;

/// Six significant digits.
double rounded(double value) {
  if (!std::isfinite(value) || value == 0) return value;
  const int digits = 5 - static_cast<int>(std::floor(std::log10(std::abs(value))));
  const double scale = std::pow(10.0, std::abs(digits));
  return digits >= 0 ? std::round(value * scale) / scale : std::round(value / scale) * scale;
}

/// Tenths of a millisecond.
double rounded_seconds(double s) { return std::round(s * 1e4) / 1e4; }

Json numbers(const std::vector<double>& values, double (*round)(double)) {
  Json out = Json::array();
  for (double v : values) out.push_back(round(v));
  return out;
}

std::optional<Time> page_zero(const RunFolder& run) {
  std::vector<Time> first;
  for (const Trajectory* trajectory : {&run.camera, &run.camera_causal, &run.imu})
    if (!trajectory->empty()) first.push_back(trajectory->front().t);
  if (!run.states.empty()) first.push_back(run.states.front().t);
  if (first.empty() && !run.windows.t.empty()) first.push_back(run.windows.t.front());
  if (first.empty())
    for (const Line& line : run.lines) first.push_back(line.first);
  if (first.empty()) return std::nullopt;
  return *std::min_element(first.begin(), first.end());
}

Json trajectory_json(const Trajectory& trajectory, const std::string& name, Time zero,
                     std::vector<std::string>& notes) {
  const std::size_t step = (trajectory.size() + kMaxPoses - 1) / kMaxPoses;
  Json t = Json::array(), p = Json::array(), q = Json::array();
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    if (i % step != 0 && i + 1 != trajectory.size()) continue;
    const StampedPose& pose = trajectory[i];
    t.push_back(rounded_seconds(seconds_between(zero, pose.t)));
    for (double v : pose.T.p) p.push_back(rounded(v));
    for (double v : pose.T.q.coeffs()) q.push_back(rounded(v));
  }
  if (step > 1)
    notes.push_back(fmt::format("The 3D view draws one in {} of the {} poses of the {} trajectory.", step,
                                trajectory.size(), name));
  return {{"t", t}, {"p", p}, {"q", q}};
}

Json lines_json(const RunFolder& run, Time zero, std::vector<std::string>& notes) {
  std::vector<Line> lines = run.lines;
  if (lines.size() > kMaxLines) {
    std::stable_sort(lines.begin(), lines.end(),
                     [](const Line& a, const Line& b) { return a.windows > b.windows; });
    lines.resize(kMaxLines);
    notes.push_back(fmt::format("The 3D view draws the {} lines seen in most windows, of {}.", kMaxLines,
                                run.lines.size()));
  }
  Json out = Json::array();
  for (const Line& line : lines) {
    const Rgb c = line_colour(line.id);
    out.push_back({{"id", line.id},
                   {"a", {rounded(line.a.x()), rounded(line.a.y()), rounded(line.a.z())}},
                   {"b", {rounded(line.b.x()), rounded(line.b.y()), rounded(line.b.z())}},
                   {"first", rounded_seconds(seconds_between(zero, line.first))},
                   {"last", rounded_seconds(seconds_between(zero, line.last))},
                   {"windows", line.windows},
                   {"colour", fmt::format("#{:02x}{:02x}{:02x}", c.r, c.g, c.b)}});
  }
  return out;
}

Json panels_json(const std::vector<Panel>& panels) {
  Json out = Json::array();
  for (const Panel& panel : panels) {
    Json series = Json::array();
    for (const Series& s : panel.series)
      series.push_back({{"name", s.name},
                        {"colour", s.colour},
                        {"style", s.style},
                        {"t", numbers(s.t, rounded_seconds)},
                        {"y", numbers(s.y, rounded)}});
    out.push_back({{"title", panel.title}, {"unit", panel.unit}, {"series", series}});
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

/// An evenly spread choice, as data URIs.
Json pictures_json(const RunFolder& run, Time zero, std::vector<std::string>& notes) {
  Json out = Json::array();
  const std::size_t n = run.pictures.size(), shown = std::min(n, kMaxPictures);
  std::size_t bytes = 0;
  for (std::size_t k = 0; k < shown; ++k) {
    const PictureFile& picture = run.pictures[k * n / shown];
    std::string content;
    try {
      content = read_file(picture.path);
    } catch (const DataError& e) {
      notes.emplace_back(e.what());
      continue;
    }
    bytes += content.size();
    if (bytes > kMaxPictureBytes) break;
    std::string caption = fmt::format("Window {}", picture.window);
    const auto row = static_cast<std::size_t>(picture.window);
    if (picture.window >= 0 && row < run.windows.t.size()) {
      caption += fmt::format(", ends at {:.2f} s", seconds_between(zero, run.windows.t[row]));
      const auto add = [&](const char* column, const char* before, const char* after) {
        const auto* values = run.windows.find(column);
        if (values != nullptr && std::isfinite((*values)[row]))
          caption += fmt::format(", {}{:.3g}{}", before, (*values)[row], after);
      };
      add("segments", "", " segments");
      add("lines", "", " lines");
      add("rms_px", "rms ", " px");
    } else {
      caption += fmt::format(", {:.2f} s", picture.seconds);
    }
    out.push_back({{"caption", caption}, {"src", "data:image/png;base64," + base64(content)}});
  }
  if (out.size() < n)
    notes.push_back(fmt::format("The page shows {} of the {} event pictures in pictures/.", out.size(), n));
  return out;
}

Json parsed(const std::string& text, const char* name, std::vector<std::string>& notes) {
  if (text.empty()) return nullptr;
  Json json = Json::parse(text, nullptr, false);
  if (json.is_object()) return json;
  notes.push_back(fmt::format("{} cannot be used: it is not a JSON object.", name));
  return nullptr;
}

Json evaluation_of(const Trajectory& estimate, const Trajectory& groundtruth) {
  return Json::parse(evaluation_json(evaluate(estimate, groundtruth, {})));
}

Json evaluations_json(const RunFolder& run, std::vector<std::string>& notes) {
  Json out = Json::array();
  Json given = parsed(run.evaluation_json, "evaluation.json", notes);
  if (!given.is_null())
    out.push_back({{"title", "Smoothed trajectory (evaluation.json)"}, {"data", given}});
  for (const auto& [title, trajectory] :
       {std::pair{"Smoothed trajectory", &run.camera}, std::pair{"Causal trajectory", &run.camera_causal}}) {
    if (trajectory->empty() || run.groundtruth.empty()) continue;
    if (trajectory == &run.camera && !given.is_null()) continue;
    try {
      out.push_back({{"title", title}, {"data", evaluation_of(*trajectory, run.groundtruth)}});
    } catch (const DataError& e) {
      notes.push_back(fmt::format("{} not evaluated: {}.", title, e.what()));
    }
  }
  return out;
}

/// Borders of the picture at distance 1, through the plain pinhole: left, top, right, bottom.
Json frustum_json(const RunFolder& run) {
  if (!run.camera_model || run.camera_model->width <= 0) return {-0.6, -0.45, 0.6, 0.45};
  const Camera& c = *run.camera_model;
  const Vec2 low = c.normalise({-0.5, -0.5}), high = c.normalise({c.width - 0.5, c.height - 0.5});
  return {rounded(low.x()), rounded(low.y()), rounded(high.x()), rounded(high.y())};
}

}  // namespace

std::string page_data(const RunFolder& run) {
  std::vector<std::string> notes = run.notes;
  const std::optional<Time> first = page_zero(run);
  const Time zero = first.value_or(0);
  const AlignedTruth truth = align_truth(run.camera, run.groundtruth);
  const AlignedTruth causal_truth = align_truth(run.camera_causal, run.groundtruth);
  if (!run.groundtruth.empty() && !run.camera.empty() && truth.matched.size() == 0)
    notes.emplace_back("No pose of the estimate has a ground-truth pose within 20 ms: no comparison.");
  Json data;
  data["zero"] = first ? Json(format_stamp(zero)) : Json(nullptr);
  data["stats"] = parsed(run.stats_json, "stats.json", notes);
  data["evaluations"] = evaluations_json(run, notes);
  data["smoothed"] = trajectory_json(run.camera, "smoothed", zero, notes);
  data["causal"] = trajectory_json(run.camera_causal, "causal", zero, notes);
  data["truth"] = trajectory_json(truth.camera, "ground-truth", zero, notes);
  data["matched"] = truth.matched.size();
  data["frustum"] = frustum_json(run);
  data["lines"] = lines_json(run, zero, notes);
  data["panels"] = panels_json(make_panels(run, truth, causal_truth, zero));
  data["trackLengths"] = track_lengths_json(run.lines);
  data["pictures"] = pictures_json(run, zero, notes);
  data["files"] = Json::array();
  for (const auto& [name, text] :
       {std::pair{"config.yaml", &run.config_yaml}, std::pair{"rig.yaml", &run.rig_yaml}})
    if (!text->empty()) data["files"].push_back({{"name", name}, {"text", *text}});
  data["notes"] = notes;
  // Neither "</script" nor "<!--" may appear, whatever the files hold: '<' is written as an escape.
  std::string safe;
  for (char c : data.dump(-1, ' ', false, Json::error_handler_t::replace))
    c == '<' ? safe += "\\u003c" : safe += c;
  return safe;
}

std::string base64(std::string_view bytes) {
  constexpr const char* kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    unsigned word = 0;
    for (std::size_t k = 0; k < 3; ++k)
      word = word << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k > bytes.size() ? '=' : kDigits[word >> (18 - 6 * k) & 63];
  }
  return text;
}

}  // namespace idol
