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
  return std::make_unique<TextSource<Event, EventParser>>(file);
}

std::unique_ptr<RowSource<ImuSample>> TextRecording::imu(Diagnostics& diagnostics) {
  const fs::path asl = find_asl("imu0");
  if (!asl.empty() && find_stream_files(folder_, "imu.txt").empty()) return open_imu_text(asl, kAslImu);
  return open_imu_text(find("imu.txt", diagnostics));
}

std::optional<Trajectory> TextRecording::groundtruth() {
  const auto files = find_stream_files(folder_, "groundtruth.txt");
  if (!files.empty()) return read_trajectory(files[0]);
  const fs::path asl = find_asl("state_groundtruth_estimate0");
  if (!asl.empty()) return read_trajectory(asl);
  return std::nullopt;
}

bool TextRecording::truth_of_imu() const { return find_stream_files(folder_, "groundtruth.txt").empty(); }

std::unique_ptr<RowSource<ImuSample>> open_imu_text(const fs::path& path, const ImuTextLayout& layout) {
  return std::make_unique<TextSource<ImuSample, ImuParser>>(path, ImuParser(layout));
}

}  // namespace idol
