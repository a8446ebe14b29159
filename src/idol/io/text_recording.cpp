#include "idol/io/text_recording.hpp"

#include <fmt/format.h>

#include <utility>

#include "idol/io/sequence_files.hpp"
#include "idol/io/text_source.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {

namespace fs = std::filesystem;

TextRecording::TextRecording(fs::path path) : path_(std::move(path)), folder_(sequence_folder(path_)) {}

fs::path TextRecording::find(const std::string& name, Diagnostics& diagnostics) const {
  const auto files = find_stream_files(folder_, name);
  if (files.empty()) {
    throw DataError(
        fmt::format("{}: no {} in this folder (nor {}.gz, {}.zst)", folder_.string(), name, name, name));
  }
  if (files.size() > 1) {
    diagnostics.warn("several_files", fmt::format("{}: read; {} lies beside it and is ignored",
                                                  files[0].string(), files[1].filename().string()));
  }
  return files[0];
}

bool TextRecording::has_events() const {
  return !fs::is_directory(path_) || !find_stream_files(folder_, "events.txt").empty();
}

fs::path TextRecording::find_asl(const char* name) const {
  std::error_code ignored;
  for (const fs::path& root : {folder_, folder_ / "mav0"})
    if (fs::exists(root / name / "data.csv", ignored)) return root / name / "data.csv";
  return {};
}

bool TextRecording::has_imu() const {
  return !find_stream_files(folder_, "imu.txt").empty() || !find_asl("imu0").empty();
}

std::unique_ptr<RowSource<Event>> TextRecording::events(Diagnostics& diagnostics) {
  const fs::path file = fs::is_directory(path_) ? find("events.txt", diagnostics) : path_;
  const EventTextLayout layout = find_event_layout(file, diagnostics);
  return std::make_unique<TextSource<Event, EventParser>>(file, EventParser(layout), layout.skip);
}

std::unique_ptr<RowSource<ImuSample>> TextRecording::imu(Diagnostics& diagnostics) {
  const fs::path asl = find_asl("imu0");
  if (!asl.empty() && find_stream_files(folder_, "imu.txt").empty())
    return open_imu_text(asl, asl_imu_layout());
  const fs::path file = find("imu.txt", diagnostics);
  return open_imu_text(file, find_imu_layout(file, diagnostics));
}

Recording::Resolution TextRecording::resolution() {
  try {
    Diagnostics unheard;
    const EventTextLayout layout =
        find_event_layout(fs::is_directory(path_) ? find("events.txt", unheard) : path_, unheard);
    return {layout.width, layout.height};
  } catch (const DataError&) {
    return {};  // whoever reads the events will hear of it
  }
}

std::optional<Trajectory> TextRecording::groundtruth() {
  const auto files = find_stream_files(folder_, "groundtruth.txt");
  fs::path file = files.empty() ? fs::path() : files[0];
  for (const char* name : {"state_groundtruth_estimate0", "mocap0"})
    if (file.empty()) file = find_asl(name);
  if (file.empty()) return std::nullopt;
  TruthFile truth = read_truth(file);
  lost_poses_ = truth.lost;
  return std::move(truth.poses);
}

std::vector<fs::path> TextRecording::files() const {
  std::vector<fs::path> files{path_};
  for (const char* name : {"events.txt", "imu.txt", "groundtruth.txt", "images.txt"})
    for (fs::path& file : find_stream_files(folder_, name)) files.push_back(std::move(file));
  for (const char* name : {"imu0", "state_groundtruth_estimate0", "mocap0"}) files.push_back(find_asl(name));
  return files;
}

bool TextRecording::truth_of_imu() const { return find_stream_files(folder_, "groundtruth.txt").empty(); }

std::unique_ptr<RowSource<Event>> ImuTextRecording::events(Diagnostics&) {
  throw DataError(fmt::format("{}: holds an IMU, no events", path_.string()));
}

std::unique_ptr<RowSource<ImuSample>> ImuTextRecording::imu(Diagnostics& diagnostics) {
  return open_imu_text(path_, find_imu_layout(path_, diagnostics));
}

std::unique_ptr<RowSource<ImuSample>> open_imu_text(const fs::path& path, const ImuTextLayout& layout) {
  return std::make_unique<TextSource<ImuSample, ImuParser>>(path, ImuParser(layout), layout.skip);
}

}  // namespace idol
