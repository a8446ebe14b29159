#include "idol/io/reader.hpp"

#include <fmt/format.h>

#include <string_view>
#include <utility>

#include "idol/io/raw_file.hpp"
#include "idol/io/sequence_files.hpp"
#include "idol/io/text_reader.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

/// Formats that would otherwise look like damaged text.
void refuse_other_formats(const fs::path& path) {
  using namespace std::string_view_literals;
  constexpr std::pair<std::string_view, const char*> kKnown[] = {
      {"#!AER-DAT"sv, "an AEDAT file"}, {"#ROSBAG"sv, "a ROS 1 bag"},         {"\x89HDF"sv, "an HDF5 file"},
      {"\x89MCAP"sv, "an MCAP file"},   {"SQLite format 3"sv, "a ROS 2 bag"}, {"PK\x03\x04"sv, "a ZIP file"},
      {"% "sv, "a Prophesee RAW file"},
  };
  RawFile file(path);
  const std::string_view start = file.peek();
  for (const auto& [magic, name] : kKnown) {
    if (start.starts_with(magic)) {
      throw DataError(
          fmt::format("{}: this is {}; events are read from text (t x y polarity), plain or compressed "
                      "with gzip or zstd",
                      path.string(), name));
    }
  }
}

}  // namespace

void check_exists(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error))
    throw DataError(fmt::format("{}: no such file or folder; give a recording's folder", path.string()));
}

std::unique_ptr<Reader> open_reader(const fs::path& path, const ReaderOptions& options) {
  check_exists(path);
  if (!fs::is_directory(path)) refuse_other_formats(path);
  return std::make_unique<TextReader>(path, options);
}

std::optional<Trajectory> read_groundtruth(const fs::path& sequence) {
  const auto files = find_stream_files(sequence_folder(sequence), "groundtruth.txt");
  if (files.empty()) return std::nullopt;
  return read_trajectory(files[0]);
}

}  // namespace idol
