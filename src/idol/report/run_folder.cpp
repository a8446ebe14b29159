#include "idol/report/run_folder.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <limits>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

CsvColumns read_csv(const fs::path& path) {
  LineReader lines(path);
  std::string_view line;
  CsvColumns csv;
  if (!lines.next(line)) throw DataError(fmt::format("{}: is empty", path.string()));
  std::vector<std::string_view> cells(split_columns(line, {}));
  split_columns(line, cells);
  std::vector<std::vector<double>*> columns;
  std::optional<std::size_t> stamp;
  for (const auto& name : cells) {
    if (name == "t") stamp = columns.size();
    columns.push_back(&csv.columns[std::string(name)]);
  }
  if (!stamp) throw DataError(fmt::format("{}: has no column 't'", lines.where()));
  while (lines.next(line)) {
    if (is_blank_or_comment(line)) continue;
    const auto t = split_columns(line, cells) == columns.size() ? parse_stamp(cells[*stamp]) : std::nullopt;
    if (!t) throw DataError(fmt::format("{}: is not a row like the header", lines.where()));
    csv.t.push_back(*t);
    for (std::size_t i = 0; i < columns.size(); ++i)
      columns[i]->push_back(parse_double(cells[i]).value_or(std::numeric_limits<double>::quiet_NaN()));
  }
  return csv;
}

// Poses of the camera are stamped by its own clock, events and frames by the IMU's as the rig had it, all
// else by the IMU's.
void use_imu_clock(RunFolder& run) {
  if (!run.refined || run.camera.empty() || run.imu.empty()) return;
  const Time offset = from_seconds(run.refined->time_offset_s);
  // Both first poses are of one state.
  const Time shift = offset - (run.imu.front().t - run.camera.front().t);
  for (Trajectory* trajectory : {&run.camera, &run.camera_causal, &run.groundtruth})
    for (StampedPose& pose : *trajectory) pose.t += offset;
  for (ShownWindow& window : run.events) window.t += shift;
  for (FrameFile& frame : run.frames) frame.t += shift;
}

/// Reads one part after the other, turning every trouble into a note.
class Collector {
 public:
  Collector(fs::path dir, std::vector<std::string>& notes) : dir_(std::move(dir)), notes_(notes) {}

  /// `what` is what the page lacks without the file; empty: the file is optional, its absence no news.
  template <class T, class Read>
  void take(T& out, const std::string& name, const std::string& what, const Read& read) {
    const fs::path path = dir_ / name;
    if (!fs::exists(path)) {
      if (!what.empty()) notes_.push_back(fmt::format("{} is not there: {} left out.", name, what));
      return;
    }
    found_ = true;
    try {
      out = read(path);
    } catch (const DataError& e) {
      notes_.push_back(fmt::format("{} cannot be used: {}", name, e.what()));
    }
  }
  [[nodiscard]] bool found() const { return found_; }

 private:
  fs::path dir_;
  std::vector<std::string>& notes_;
  bool found_ = false;
};

}  // namespace

const std::vector<double>* CsvColumns::find(const std::string& name) const {
  const auto it = columns.find(name);
  return it == columns.end() ? nullptr : &it->second;
}

std::optional<Time> first_stamp(const RunFolder& run) {
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

std::string read_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text(std::istreambuf_iterator<char>(in), {});
  if (!in) throw DataError(fmt::format("{}: cannot be read", path.string()));
  return text;
}

RunFolder read_run_folder(const fs::path& dir) {
  if (!fs::is_directory(dir))
    throw DataError(fmt::format("{}: no such folder; give the folder a run was written to", dir.string()));
  RunFolder run;
  Collector collect(dir, run.notes);
  collect.take(run.stats_json, "stats.json", "the run's figures and warnings", read_file);
  collect.take(run.camera, "trajectory_camera.txt", "the trajectory of the camera", read_trajectory);
  collect.take(run.imu, "trajectory_imu.txt", "the trajectory of the IMU", read_trajectory);
  collect.take(run.camera_causal, "trajectory_camera_causal.txt", "the causal trajectory", read_trajectory);
  collect.take(run.imu_causal, "trajectory_imu_causal.txt", "", read_trajectory);
  collect.take(run.states, "states.csv", "velocity and biases", read_states);
  collect.take(run.states_causal, "states_causal.csv", "the causal velocity and biases", read_states);
  collect.take(run.events, "events_shown.bin", "the view of the events", read_event_log);
  collect.take(run.lines, "lines.csv", "lines and their track lengths", read_lines_csv);
  collect.take(run.windows, "windows.csv", "the curves by window", read_csv);
  collect.take(run.groundtruth, "groundtruth_camera.txt", "the comparison with ground truth",
               read_trajectory);
  collect.take(run.evaluation_json, "evaluation.json", "", read_file);
  collect.take(run.config_yaml, "config.yaml", "the configuration", read_file);
  collect.take(run.rig_yaml, "rig.yaml", "the rig", read_file);
  if (!run.rig_yaml.empty())
    collect.take(run.camera_model, "rig.yaml", "",
                 [&](const fs::path& path) { return find_camera(dir, path); });
  collect.take(run.refined, "rig_refined.yaml", "the truth beside the state",
               [](const fs::path& path) { return load_rig({}, path); });
  run.frames = find_frames(dir / "frames");
  if (!collect.found())
    throw DataError(
        fmt::format("{}: holds nothing of a run (no stats.json, no trajectory); give the folder 'idol run "
                    "--out' wrote to",
                    dir.string()));
  use_imu_clock(run);
  return run;
}

}  // namespace idol
