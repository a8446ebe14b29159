#include "idol/io/output_guard.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <fstream>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/text_writer.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

constexpr const char* kMarker = ".idol-folder";

std::string_view name_of(FolderContent content) {
  switch (content) {
    case FolderContent::kRun:
      return "run";
    case FolderContent::kRecording:
      return "recording";
    case FolderContent::kPictures:
      break;
  }
  return "pictures";
}

[[noreturn]] void refuse(const fs::path& output, const std::string& why) {
  throw UsageError(fmt::format("{}: {}", output.string(), why));
}

/// The folders above `path`, the nearest first, with all links followed.
std::vector<fs::path> folders_above(const fs::path& path) {
  std::error_code error;
  std::vector<fs::path> above;
  fs::path at = fs::weakly_canonical(fs::absolute(path, error), error);
  while (at.has_parent_path() && at != at.parent_path()) {
    at = at.parent_path();
    above.push_back(at);
  }
  return above;
}

void remove_pngs(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> pictures;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".png" && entry.is_regular_file(error)) pictures.push_back(entry.path());
  for (const fs::path& picture : pictures) fs::remove(picture, error);
}

}  // namespace

bool InputPaths::identify(const fs::path& path, Input& found) {
  struct stat status {};
  if (path.empty() || ::stat(path.c_str(), &status) != 0) return false;
  if (!S_ISREG(status.st_mode) && !S_ISDIR(status.st_mode)) return false;  // a terminal, /dev/null
  found = {path, {status.st_dev, status.st_ino}, S_ISDIR(status.st_mode)};
  return true;
}

void InputPaths::add(const fs::path& path) {
  if (Input input; identify(path, input)) inputs_.push_back(std::move(input));
}

void InputPaths::add_recording(const fs::path& sequence, const StreamChoice& choice, const fs::path& rig,
                               const fs::path& imu_rig) {
  for (const fs::path& path : {sequence, choice.imu_file, rig, imu_rig}) add(path);
  try {
    for (const fs::path& file : open_recording(sequence, choice)->files()) add(file);
    for (const fs::path& file : rig_files(sequence, rig)) add(file);
  } catch (const std::runtime_error&) {  // DataError, UsageError
    // Whoever reads it says what is wrong.
  }
}

void InputPaths::add_files(const fs::path& path) {
  if (!fs::is_directory(path)) return add(path);
  try {
    for (const fs::path& file : open_recording(path)->files())
      if (!fs::is_directory(file)) add(file);
  } catch (const std::runtime_error&) {  // DataError, UsageError
    // Whoever reads it says what is wrong.
  }
}

void InputPaths::refuse_output(const fs::path& output) const {
  Input there;
  const bool exists = identify(output, there);
  if (!exists && fs::exists(output)) return;  // a pipe or a device: nothing is lost
  const auto find = [&](const Input& other) {
    return std::find_if(inputs_.begin(), inputs_.end(), [&](const Input& i) { return i.id == other.id; });
  };
  if (exists && find(there) != inputs_.end()) refuse(output, "is to be read and written; give another");
  for (const fs::path& folder : folders_above(output)) {
    Input above;
    if (!identify(folder, above)) continue;
    if (const auto input = find(above); input != inputs_.end())
      refuse(output,
             fmt::format("lies in {}, which is to be read; give a place outside", input->path.string()));
  }
  if (!exists || !there.folder) return;
  const auto holds = [&](const fs::path& input) {
    refuse(output, fmt::format("holds {}, which is to be read; give another folder", input.string()));
  };
  for (const Input& input : inputs_)
    for (const fs::path& folder : folders_above(input.path))
      if (Input above; identify(folder, above) && above.id == there.id) holds(input.path);
  // A second name of an input in the folder.
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(output, error))
    if (Input inside; identify(entry.path(), inside))
      if (const auto input = find(inside); input != inputs_.end()) holds(input->path);
}

bool is_claimed(const fs::path& folder, FolderContent content) {
  std::ifstream marker(folder / kMarker);
  std::string line;
  return std::getline(marker, line) && line == name_of(content);
}

void claim_folder(const fs::path& folder, FolderContent content) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    throw DataError(
        fmt::format("{}: cannot be created: {}; give another folder", folder.string(), error.message()));
  if (is_claimed(folder, content)) return;
  fs::directory_iterator entries(folder, error);
  if (error)
    throw DataError(
        fmt::format("{}: cannot be read: {}; give another folder", folder.string(), error.message()));
  // A shell makes the log that output is sent to before this program begins; nothing here is called so.
  const auto is_log = [](const fs::directory_entry& entry) { return entry.path().extension() == ".log"; };
  if (!std::all_of(begin(entries), end(entries), is_log))
    refuse(folder, fmt::format("holds files, and was not made for a {} by this program: they might be "
                               "replaced; give an empty or a new folder",
                               name_of(content)));
  write_text_file(
      folder / kMarker,
      fmt::format("{}\nidol made this folder and may replace what it wrote here.\n", name_of(content)));
}

void claim_and_clear_pictures(const fs::path& folder) {
  claim_folder(folder, FolderContent::kPictures);
  remove_pngs(folder);
}

void remove_pictures(const fs::path& folder) {
  if (!is_claimed(folder, FolderContent::kPictures)) return;
  remove_pngs(folder);
  std::error_code error;
  const auto left = std::distance(fs::directory_iterator(folder, error), fs::directory_iterator());
  if (left > 1) return;
  fs::remove(folder / kMarker, error);
  fs::remove(folder, error);
}

}  // namespace idol
