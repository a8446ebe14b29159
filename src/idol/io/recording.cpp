#include "idol/io/recording.hpp"

#include <fmt/format.h>

#include <string_view>

#include "idol/io/raw_file.hpp"
#include "idol/io/text_recording.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

using namespace std::string_view_literals;

/// Formats that would otherwise look like damaged text.
void refuse_other_formats(const fs::path& path, std::string_view start) {
  constexpr std::pair<std::string_view, const char*> kKnown[] = {
      {"#!AER-DAT"sv, "an AEDAT file"}, {"#ROSBAG"sv, "a ROS 1 bag"},         {"\x89HDF"sv, "an HDF5 file"},
      {"\x89MCAP"sv, "an MCAP file"},   {"SQLite format 3"sv, "a ROS 2 bag"}, {"PK\x03\x04"sv, "a ZIP file"},
      {"% "sv, "a Prophesee RAW file"},
  };
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

std::unique_ptr<Recording> open_recording(const fs::path& path, const StreamChoice&) {
  check_exists(path);
  if (!fs::is_directory(path)) {
    RawFile file(path);
    refuse_other_formats(path, file.peek());
  }
  return std::make_unique<TextRecording>(path);
}

}  // namespace idol
