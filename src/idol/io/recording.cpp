#include "idol/io/recording.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>
#include <utility>

#include "idol/io/aedat_recording.hpp"
#include "idol/io/bag_recording.hpp"
#include "idol/io/hdf5_recording.hpp"
#include "idol/io/raw_file.hpp"
#include "idol/io/text_recording.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

using namespace std::string_view_literals;

template <class Format>
std::unique_ptr<Recording> open_as(const fs::path& path, const StreamChoice& choice) {
  return std::make_unique<Format>(path, choice);
}

/// A format known by its first bytes.
struct KnownFormat {
  std::string_view magic;
  std::unique_ptr<Recording> (*open)(const fs::path&, const StreamChoice&);  ///< nullptr: cannot be read
  const char* name;
};

constexpr KnownFormat kKnown[] = {
    {"#!AER-DAT4"sv, open_as<AedatRecording>, "an AEDAT 4 file"},
    {"#ROSBAG"sv, open_as<BagRecording>, "a ROS 1 bag"},
    {"\x89HDF\r\n\x1a\n"sv, open_as<Hdf5Recording>, "an HDF5 file"},
    {"#!AER-DAT"sv, nullptr, "an AEDAT file of version 3 or older"},
    {"\x89MCAP"sv, nullptr, "an MCAP file"},
    {"SQLite format 3"sv, nullptr, "a ROS 2 bag"},
    {"PK\x03\x04"sv, nullptr, "a ZIP file"},
    {"% "sv, nullptr, "a Prophesee RAW file"},
};

/// What the first bytes of a file say; nullptr: text, or nothing known. Throws DataError if it cannot be
/// read.
const KnownFormat* known_format(const fs::path& path) {
  RawFile file(path);
  const auto* found =
      std::find_if(std::begin(kKnown), std::end(kKnown),
                   [start = file.peek()](const KnownFormat& f) { return start.starts_with(f.magic); });
  return found == std::end(kKnown) ? nullptr : found;
}

/// The files in a folder that are recordings of a binary format, by name.
std::vector<fs::path> recordings_in(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    if (!entry.is_regular_file(ignored)) continue;
    try {
      if (const KnownFormat* format = known_format(entry.path());
          format != nullptr && format->open != nullptr)
        found.push_back(entry.path());
    } catch (const DataError&) {
      // Empty, or not to be read: none.
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::unique_ptr<Recording> open_file(const fs::path& path, const StreamChoice& choice) {
  const KnownFormat* format = known_format(path);
  if (format == nullptr) return std::make_unique<TextRecording>(path);
  if (format->open != nullptr) return format->open(path, choice);
  throw DataError(
      fmt::format("{}: this is {}, which is not read; convert it to text (t x y polarity), a ROS 1 bag, "
                  "AEDAT 4 or HDF5",
                  path.string(), format->name));
}

/// A recording with the IMU (and, where it has none itself, the truth) of another one.
class JoinedRecording : public Recording {
 public:
  JoinedRecording(std::unique_ptr<Recording> main, std::unique_ptr<Recording> imu)
      : main_(std::move(main)), imu_(std::move(imu)) {}

  [[nodiscard]] std::string format() const override {
    return fmt::format("{}, IMU: {}", main_->format(), imu_->format());
  }
  [[nodiscard]] bool has_events() const override { return main_->has_events(); }
  [[nodiscard]] bool has_imu() const override { return imu_->has_imu(); }
  std::unique_ptr<RowSource<Event>> events(Diagnostics& d) override { return main_->events(d); }
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& d) override { return imu_->imu(d); }
  std::optional<Trajectory> groundtruth() override {
    if (auto truth = main_->groundtruth()) return truth;
    truth_of_imu_ = imu_->truth_of_imu();
    return imu_->groundtruth();
  }
  [[nodiscard]] bool truth_of_imu() const override { return truth_of_imu_; }
  std::unique_ptr<FrameSource> frames() override { return main_->frames(); }
  std::vector<StreamInfo> streams() override { return main_->streams(); }
  Resolution resolution() override { return main_->resolution(); }

 private:
  std::unique_ptr<Recording> main_, imu_;
  bool truth_of_imu_ = false;
};

std::unique_ptr<Recording> open_folder(const fs::path& folder, const StreamChoice& choice) {
  auto text = std::make_unique<TextRecording>(folder);
  if (text->has_events()) return text;
  const auto files = recordings_in(folder);
  if (files.empty()) return text;  // the IMU alone; without one it says what is missing
  if (files.size() > 1) {
    std::vector<std::string> names;
    for (const fs::path& file : files) names.push_back(file.filename().string());
    throw UsageError(fmt::format("{}: holds several recordings: {}; give one of them", folder.string(),
                                 fmt::join(names, ", ")));
  }
  auto main = open_file(files[0], choice);
  if (main->has_imu() || !text->has_imu()) return main;
  return std::make_unique<JoinedRecording>(std::move(main), std::move(text));
}

}  // namespace

void check_exists(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error))
    throw DataError(
        fmt::format("{}: no such file or folder; give a recording's folder or file", path.string()));
}

bool holds_recording(const fs::path& path) {
  check_exists(path);
  return fs::is_directory(path) || known_format(path) != nullptr;
}

std::unique_ptr<Recording> open_recording(const fs::path& path, const StreamChoice& choice) {
  check_exists(path);
  auto recording = fs::is_directory(path) ? open_folder(path, choice) : open_file(path, choice);
  if (choice.imu_file.empty()) return recording;
  StreamChoice other = choice;
  other.imu_file.clear();
  return std::make_unique<JoinedRecording>(std::move(recording), open_recording(choice.imu_file, other));
}

StatedSize stated_size(const fs::path& path, const StreamChoice& choice) {
  return [path, choice] {
    const auto size = open_recording(path, choice)->resolution();
    return std::pair(size.width, size.height);
  };
}

}  // namespace idol
