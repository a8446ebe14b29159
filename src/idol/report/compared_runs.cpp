#include "idol/report/compared_runs.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "idol/base/diagnostics.hpp"
#include "idol/eval/evaluation_output.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::vector<ComparedFigure> list_figures() {
  std::vector<ComparedFigure> list;
  for (const bool causal : {true, false}) {
    const auto add = [&](const char* key, const char* protocol, const char* title, const std::string& path,
                         double factor, int digits, bool by_default, int better = -1) {
      const bool gated = by_default && path.ends_with("rmse");
      list.push_back({std::string(causal ? "causal_" : "") + key,
                      fmt::format("{} {}", causal ? "causal" : "smoothed", protocol), title,
                      causal ? FigureSourceKind::kCausal : FigureSourceKind::kSmoothed, "/protocols/" + path,
                      factor, digits, better, by_default, gated});
    };
    add("full_rmse", "full", "RMSE mm", "full/translation_m/rmse", 1000, 2, true);
    add("full_rot", "full", "RMSE deg", "full/rotation_deg/rmse", 1, 3, true);
    add("full_mpe", "full", "MPE %", "full/mpe_percent", 1, 3, true);
    add("idol_rmse", "idol", "RMSE mm", "idol/translation_m/rmse", 1000, 2, false);
    add("idol_rot", "idol", "RMSE deg", "idol/rotation_deg/rmse", 1, 3, false);
    add("idol_yaw_rmse", "idol*", "RMSE mm", "idol/yaw_from_rotations/translation_m/rmse", 1000, 2, false);
    add("idol_yaw_rot", "idol*", "RMSE deg", "idol/yaw_from_rotations/rotation_deg/rmse", 1, 3, false);
    add("uslam_mpe", "uslam", "MPE %", "uslam/mpe_percent", 1, 3, false);
    add("uslam_mye", "uslam", "MYE deg/m", "uslam/mye_deg_per_m", 1, 4, false);
    add("hku_mpe", "hku", "MPE %", "hku/mpe_percent", 1, 3, false);
    add("sim3_rmse", "sim3", "RMSE mm", "sim3/translation_m/rmse", 1000, 2, false);
    add("sim3_scale", "sim3", "scale", "sim3/scale", 1, 5, false, 0);
    for (const int percent : kSegmentPercents) {
      const std::string key = fmt::format("segments{}", percent),
                        group = fmt::format("segments {} %", percent);
      const std::string path = fmt::format("segments/{}/", percent);
      add((key + "_percent").c_str(), group.c_str(), "median %", path + "translation_percent/median", 1, 3,
          false);
      add((key + "_rot").c_str(), group.c_str(), "median deg", path + "rotation_deg/median", 1, 3, false);
    }
    list.push_back({causal ? "causal_covered" : "covered", causal ? "causal" : "smoothed", "covered %",
                    causal ? FigureSourceKind::kCausal : FigureSourceKind::kSmoothed, "/coverage", 100, 1, 1,
                    false, false});
  }
  const auto add = [&](const char* key, const char* title, const char* path, int digits, int better,
                       bool by_default, double factor = 1, bool averaged = true) {
    list.push_back(
        {key, "", title, FigureSourceKind::kRun, path, factor, digits, better, by_default, false, averaged});
  };
  add("realtime_factor", "real-time factor", "/realtime_factor", 2, 1, true);
  add("memory", "memory MB", "/peak_rss_mb", 0, -1, true);
  add("latency", "latency ms", "/latency_s/median", 1, -1, true, 1000);
  add("latency_p99", "latency 99 % ms", "/latency_s/p99", 1, -1, false, 1000);
  add("restarts", "restarts", "/restarts", 0, -1, true, 1, false);
  add("first_good_pose", "first good pose s", "/first_good_pose_s", 2, -1, false);
  add("wall", "wall s", "/wall_s", 2, -1, false);
  add("duration", "recording s", "/duration_s", 2, 0, false, 1, false);
  add("windows", "windows", "/windows", 0, 0, false, 1, false);
  add("lines", "lines", "/lines", 0, 0, false, 1, false);
  add("iterations", "iterations", "/solver_iterations", 0, -1, false);
  return list;
}

Json read_json(const fs::path& path) {
  Json json = Json::parse(read_file(path), nullptr, false);
  if (!json.is_object())
    throw DataError(fmt::format("{}: is not a JSON object; run 'idol run' again", path.string()));
  return json;
}

/// The file if it is there; else the trajectory is judged if there is truth; else nothing.
Json evaluation_of(const fs::path& dir, const char* file, const char* trajectory) {
  if (fs::exists(dir / file)) return read_json(dir / file);
  const fs::path truth = dir / "groundtruth_camera.txt";
  if (!fs::exists(truth) || !fs::exists(dir / trajectory)) return {};
  return Json::parse(
      evaluation_json(evaluate(read_trajectory(dir / trajectory), read_trajectory(truth), {})));
}

double figure_at(const Json& json, const std::string& path) {
  const Json::json_pointer pointer(path);
  if (!json.contains(pointer) || !json.at(pointer).is_number())
    return std::numeric_limits<double>::quiet_NaN();
  return json.at(pointer).get<double>();
}

/// "data/shapes/" and "data/shapes.bag" are both "shapes"; an events file goes by its folder.
std::string recording_name(const std::string& sequence) {
  fs::path path = fs::path(sequence).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  if (path.filename().string().starts_with("events.") && path.has_parent_path()) path = path.parent_path();
  return path.has_stem() ? path.stem().string() : sequence;
}

std::string text_at(const Json& json, const char* key) {
  return json.contains(key) && json[key].is_string() ? json[key].get<std::string>() : "";
}

ComparedRun read_run(const fs::path& dir) {
  ComparedRun run;
  run.dir = dir;
  const Json stats = read_json(dir / "stats.json");
  run.recording = recording_name(text_at(stats, "sequence"));
  run.preset = text_at(stats, "preset");
  const std::string status = text_at(stats, "status");
  if (status != "done" && !status.empty()) run.trouble = status;
  if (fs::exists(dir / "config.yaml")) run.config_yaml = read_file(dir / "config.yaml");
  Json smoothed, causal;
  try {
    smoothed = evaluation_of(dir, "evaluation.json", "trajectory_camera.txt");
    causal = evaluation_of(dir, "evaluation_causal.json", "trajectory_camera_causal.txt");
  } catch (const DataError& e) {
    run.trouble = e.what();
  }
  for (const ComparedFigure& figure : compared_figures()) {
    const Json& source = figure.source == FigureSourceKind::kRun      ? stats
                         : figure.source == FigureSourceKind::kCausal ? causal
                                                                      : smoothed;
    run.figures.push_back(figure.factor * figure_at(source, figure.path));
  }
  return run;
}

/// The run itself, or all that lie in the folder, by name.
std::vector<fs::path> run_dirs(const fs::path& dir) {
  if (!fs::is_directory(dir))
    throw DataError(fmt::format("{}: no such folder; give folders of runs", dir.string()));
  if (fs::exists(dir / "stats.json")) return {fs::canonical(dir)};
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator(dir))
    if (fs::exists(entry.path() / "stats.json")) found.push_back(fs::canonical(entry.path()));
  std::sort(found.begin(), found.end());
  if (found.empty())
    throw DataError(fmt::format(
        "{}: holds no run (no stats.json), nor a folder of one; give folders that 'idol run --out' "
        "wrote to, or the folder they are in",
        dir.string()));
  return found;
}

/// The last `parts` parts of the run's folder; the recording's own name does not count.
std::string folder_name(const ComparedRun& run, int parts) {
  fs::path path = run.dir.filename() == run.recording ? run.dir.parent_path() : run.dir, name;
  for (; parts > 0 && path.has_filename(); --parts, path = path.parent_path())
    name = name.empty() ? path.filename() : path.filename() / name;
  return name.string();
}

void name_runs(std::vector<ComparedRun>& runs) {
  constexpr int kDeepest = 20;
  for (int parts = 1; parts <= kDeepest; ++parts) {
    std::set<std::pair<std::string, std::string>> seen;
    for (ComparedRun& run : runs) {
      run.name = folder_name(run, parts);
      seen.emplace(run.recording, run.name);
    }
    if (seen.size() == runs.size()) return;
  }
}

/// By name where names repeat (out/realtime/A, out/realtime/B), else by equal options.
void find_configurations(std::vector<ComparedRun>& runs) {
  std::map<std::string, int> uses;
  for (const ComparedRun& run : runs) ++uses[run.name];
  std::map<std::pair<std::string, std::string>, std::vector<ComparedRun*>> alike;
  for (ComparedRun& run : runs) {
    run.configuration = run.name;
    if (uses[run.name] == 1 && !run.config_yaml.empty()) alike[{run.preset, run.config_yaml}].push_back(&run);
  }
  for (auto& [options, members] : alike) {
    std::set<std::string> recordings, names;
    for (const ComparedRun* run : members) {
      recordings.insert(run->recording);
      names.insert(run->name);
    }
    // Two of one recording are compared for another reason than their options.
    if (members.size() < 2 || recordings.size() < members.size()) continue;
    for (ComparedRun* run : members) run->configuration = fmt::format("{}", fmt::join(names, ", "));
  }
}

}  // namespace

const std::vector<ComparedFigure>& compared_figures() {
  static const std::vector<ComparedFigure> figures = list_figures();
  return figures;
}

std::vector<ComparedRun> find_runs(const std::vector<fs::path>& dirs) {
  std::vector<ComparedRun> runs;
  std::set<fs::path> known;
  for (const fs::path& given : dirs)
    for (const fs::path& dir : run_dirs(given))
      if (known.insert(dir).second) runs.push_back(read_run(dir));
  name_runs(runs);
  find_configurations(runs);
  return runs;
}

}  // namespace idol
