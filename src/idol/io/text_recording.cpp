#include "idol/io/text_recording.hpp"

#include <fmt/format.h>

#include <utility>

#include "idol/io/rows.hpp"
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

bool TextRecording::has_imu() const { return !find_stream_files(folder_, "imu.txt").empty(); }

std::unique_ptr<RowSource<Event>> TextRecording::events(Diagnostics& diagnostics) {
  const fs::path file = fs::is_directory(path_) ? find("events.txt", diagnostics) : path_;
  return std::make_unique<TextSource<Event, EventParser>>(file);
}

std::unique_ptr<RowSource<ImuSample>> TextRecording::imu(Diagnostics& diagnostics) {
  return open_imu_text(find("imu.txt", diagnostics));
}

std::optional<Trajectory> TextRecording::groundtruth() {
  const auto files = find_stream_files(folder_, "groundtruth.txt");
  if (files.empty()) return std::nullopt;
  return read_trajectory(files[0]);
}

std::unique_ptr<RowSource<ImuSample>> open_imu_text(const fs::path& path) {
  return std::make_unique<TextSource<ImuSample, ImuParser>>(path);
}

}  // namespace idol
