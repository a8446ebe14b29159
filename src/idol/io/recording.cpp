#include "idol/io/recording.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

#include "idol/io/aedat_recording.hpp"
#include "idol/io/bag_recording.hpp"
#include "idol/io/byte_source.hpp"
#include "idol/io/chained_recording.hpp"
#include "idol/io/hdf5_recording.hpp"
#include "idol/io/raw_file.hpp"
#include "idol/io/sensor_size.hpp"
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
  // Also in a compressed one.
  std::array<char, 32> bytes{};
  const std::size_t count = open_bytes(path)->read(bytes.data(), bytes.size());
  const auto* found = std::find_if(std::begin(kKnown), std::end(kKnown),
                                   [start = std::string_view(bytes.data(), count)](const KnownFormat& f) {
                                     return start.starts_with(f.magic);
                                   });
  return found == std::end(kKnown) ? nullptr : found;
}

/// The files in a folder that are recordings of a binary format, by name.
std::vector<fs::path> recordings_in(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    // Hidden ones are none of the user's: those of an editor, or of a conversion that was killed.
    if (!entry.is_regular_file(ignored) || entry.path().filename().string().starts_with('.')) continue;
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

/// Text has no topics to choose from; a choice that is for the IMU of another recording is not meant for it.
std::unique_ptr<TextRecording> open_text(const fs::path& path, const StreamChoice& choice) {
  const bool imu_elsewhere = !choice.imu_file.empty();
  for (const auto& [option, name] :
       {std::pair("--events-topic", choice.events), std::pair("--imu-topic", imu_elsewhere ? "" : choice.imu),
        std::pair("--truth-topic", imu_elsewhere ? "" : choice.truth)})
    if (!name.empty())
      throw UsageError(fmt::format("{}: {} '{}': this is a recording of text files, which have no topics",
                                   path.string(), option, printable(name)));
  return std::make_unique<TextRecording>(path);
}

std::unique_ptr<Recording> open_file(const fs::path& path, const StreamChoice& choice) {
  const KnownFormat* format = known_format(path);
  if (format == nullptr) return open_text(path, choice);
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
    truth_ = main_.get();
    if (auto truth = main_->groundtruth()) return truth;
    truth_ = imu_.get();
    return imu_->groundtruth();
  }
  [[nodiscard]] std::int64_t lost_poses() const override {
    return truth_ != nullptr ? truth_->lost_poses() : 0;
  }
  [[nodiscard]] bool truth_of_imu() const override { return truth_ == imu_.get() && imu_->truth_of_imu(); }
  std::unique_ptr<FrameSource> frames() override { return main_->frames(); }
  std::vector<StreamInfo> streams() override { return main_->streams(); }
  Resolution resolution() override { return main_->resolution(); }
  [[nodiscard]] std::vector<fs::path> files() const override {
    auto files = main_->files();
    for (fs::path& file : imu_->files()) files.push_back(std::move(file));
    return files;
  }

 private:
  std::unique_ptr<Recording> main_, imu_;
  const Recording* truth_ = nullptr;  // of the two
};

/// Files of one recording, as `rosbag record --split` numbers them: NAME_0.bag, NAME_1.bag and so on.
bool is_split(const std::vector<fs::path>& files) {
  if (files.size() < 2) return false;
  const std::string first = files[0].filename().string(), ending = files[0].extension().string();
  const std::string stem = first.substr(0, first.size() - std::min(first.size(), ending.size() + 1));
  std::vector<std::string> expected;
  for (std::size_t i = 0; i < files.size(); ++i) expected.push_back(fmt::format("{}{}{}", stem, i, ending));
  std::sort(expected.begin(), expected.end());
  return stem.ends_with('_') &&
         std::equal(files.begin(), files.end(), expected.begin(), expected.end(),
                    [](const fs::path& file, const std::string& name) { return file.filename() == name; });
}

std::unique_ptr<Recording> open_folder(const fs::path& folder, const StreamChoice& choice) {
  auto text = std::make_unique<TextRecording>(folder);
  if (text->has_events()) return open_text(folder, choice);
  const auto files = recordings_in(folder);
  if (files.empty()) return text;  // the IMU alone; without one it says what is missing
  if (is_split(files)) {
    std::vector<std::unique_ptr<Recording>> parts;
    for (const fs::path& file : files) parts.push_back(open_file(file, choice));
    return std::make_unique<ChainedRecording>(std::move(parts));
  }
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

/// What --imu names: a recording that has an IMU, or a text file of nothing else.
std::unique_ptr<Recording> open_imu(const StreamChoice& choice) {
  const fs::path& path = choice.imu_file;
  check_exists(path);
  if (!fs::is_directory(path) && known_format(path) == nullptr)
    return std::make_unique<ImuTextRecording>(path);
  StreamChoice other = choice;
  other.imu_file.clear();
  auto recording = open_recording(path, other);
  if (!recording->has_imu())
    throw DataError(fmt::format("{}: is to give the IMU (--imu), but holds no IMU data", path.string()));
  return recording;
}

}  // namespace

void check_exists(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error))
    throw DataError(
        fmt::format("{}: no such file or folder; give a recording's folder or file", path.string()));
  refuse_pipe(path);
}

bool holds_recording(const fs::path& path) {
  check_exists(path);
  return fs::is_directory(path) || known_format(path) != nullptr;
}

std::unique_ptr<Recording> open_recording(const fs::path& path, const StreamChoice& choice) {
  check_exists(path);
  auto recording = fs::is_directory(path) ? open_folder(path, choice) : open_file(path, choice);
  if (choice.imu_file.empty()) return recording;
  return std::make_unique<JoinedRecording>(std::move(recording), open_imu(choice));
}

StatedSize stated_size(const fs::path& path, const StreamChoice& choice) {
  return [path, choice] {
    const auto size = open_recording(path, choice)->resolution();
    return std::pair(size.width, size.height);
  };
}

CameraChoice camera_choice(const fs::path& path, const StreamChoice& choice) {
  const auto seen = [path, choice] {
    constexpr std::int64_t kEnough = 200'000;
    Diagnostics unheard;
    SizeSeen size;
    std::int64_t count = 0;
    try {
      const auto source = open_recording(path, choice)->events(unheard);
      for (auto rows = source->read(); count < kEnough; rows = source->read()) {
        if (rows.empty() && source->odd().status == RowStatus::kGood) break;
        size.add(rows);
        count += std::ssize(rows);
      }
      if (size.empty()) return std::pair(0, 0);
      const auto [width, height] = size.size(path.string());
      return std::pair(width, height);
    } catch (const DataError&) {
      return std::pair(0, 0);  // whoever reads the events says what is wrong
    }
  };
  return {choice.camera, stated_size(path, choice), seen};
}

}  // namespace idol
