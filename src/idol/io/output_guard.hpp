// What a job may write to: never what it reads, and no folder that holds anything of the user's.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "idol/io/recording.hpp"

namespace idol {

/// The files and folders that a job reads. They are told apart by device and inode: another name, a link or a
/// mount of the same file is the same file.
class InputPaths {
 public:
  /// A file or folder; what is empty or does not exist is left out.
  void add(const std::filesystem::path& path);
  /// A recording with what is read beside it: its streams' files, its calibration.
  void add_recording(const std::filesystem::path& sequence, const StreamChoice& choice,
                     const std::filesystem::path& rig = {}, const std::filesystem::path& imu_rig = {});
  /// The files of a recording, or a file of another kind; beside them in a folder may be written.
  void add_files(const std::filesystem::path& path);
  /// Throws UsageError if `output`, a file or folder that need not exist, is one of these, holds one of these
  /// or lies in one of these. To be asked before anything is written.
  void refuse_output(const std::filesystem::path& output) const;

 private:
  struct Id {
    std::uint64_t device = 0, inode = 0;
    bool operator==(const Id&) const = default;
  };
  struct Input {
    std::filesystem::path path;
    Id id;
    bool folder = false;
  };
  static bool identify(const std::filesystem::path& path, Input& found);

  std::vector<Input> inputs_;
};

/// What a folder that this program fills is good for; written into a file of its own in it.
enum class FolderContent { kRun, kRecording, kPictures };

/// Creates the folder, or takes one that is empty or was made for the same content by this program before:
/// the job may replace results in it. Throws UsageError if it holds anything else, DataError if it cannot be
/// created.
void claim_folder(const std::filesystem::path& folder, FolderContent content);
/// Whether claim_folder() has made or taken it for this.
bool is_claimed(const std::filesystem::path& folder, FolderContent content);
/// Takes a folder of pictures and removes those in it whose names end in `.png`; whatever else lies there
/// stays.
void claim_and_clear_pictures(const std::filesystem::path& folder);
/// Removes a claimed folder of pictures; one with anything else in it, or not this program's, stays.
void remove_pictures(const std::filesystem::path& folder);

}  // namespace idol
