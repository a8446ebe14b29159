// What a file or folder holds, stream by stream. One derived class a format; order, spans and packets are
// made of it by StreamReader, for all formats alike.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/io/frame.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

/// Which streams to take where a recording has several: a topic of a bag, a stream of an AEDAT4 file, a group
/// of an HDF5 file. Empty: the only one, or the one that is usual for the format.
struct StreamChoice {
  std::string events, imu, truth;
  std::filesystem::path imu_file;  ///< the IMU from this recording instead; empty: from the same
  std::string camera = {};         ///< of several in the rig file, as CameraChoice::name
};

/// One of the streams in a recording, for `idol info`.
struct StreamInfo {
  std::string name;         ///< topic, stream or data set
  std::string what;         ///< events, frames, triggers, a message type
  std::int64_t count = -1;  ///< -1: not known without reading it all
};

class Recording {
 public:
  virtual ~Recording() = default;

  /// Name of the format, for people.
  [[nodiscard]] virtual std::string format() const = 0;
  [[nodiscard]] virtual bool has_events() const = 0;
  [[nodiscard]] virtual bool has_imu() const = 0;
  /// Each call begins a new pass over the stream; several may be open at a time. Throws DataError, naming
  /// what there is instead, if the recording has no such stream, and UsageError if there are several and
  /// `choice` names none of them. `diagnostics` must outlive the source.
  virtual std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) = 0;
  virtual std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) = 0;
  /// Pose of the camera in the world, if the recording has it. Throws DataError if it is damaged.
  virtual std::optional<Trajectory> groundtruth() { return std::nullopt; }
  /// After groundtruth(): how many poses in it were lost, and left out.
  [[nodiscard]] virtual std::int64_t lost_poses() const { return 0; }
  /// Whether groundtruth() is of the IMU instead of the camera.
  [[nodiscard]] virtual bool truth_of_imu() const { return false; }
  /// Pictures beside the events, for reports; nullptr: none, or not read from this format. Of several streams
  /// the first one.
  virtual std::unique_ptr<FrameSource> frames() { return nullptr; }
  /// The files that are read, as far as they exist.
  [[nodiscard]] virtual std::vector<std::filesystem::path> files() const = 0;
  /// All streams that the file names, those included that no odometry reads (triggers).
  virtual std::vector<StreamInfo> streams() { return {}; }
  /// Size of the sensor as the recording states it [px]; zero where it does not.
  struct Resolution {
    int width = 0, height = 0;
  };
  virtual Resolution resolution() { return {}; }
};

/// Throws DataError unless there is a file or folder at `path`.
void check_exists(const std::filesystem::path& path);

/// Whether `path` is a folder, or a file of one of the binary formats: no table of text.
bool holds_recording(const std::filesystem::path& path);

/// Opens a recording, whatever its format: decided by content, not by name. A folder may be a recording of
/// its own (text, ASL) or hold one file that is. Throws DataError.
std::unique_ptr<Recording> open_recording(const std::filesystem::path& path, const StreamChoice& choice = {});

/// For load_rig(): opens the recording when its size is asked for.
StatedSize stated_size(const std::filesystem::path& path, const StreamChoice& choice = {});
/// The same for a rig file of several cameras; looks at the first events where the recording does not state
/// its size.
CameraChoice camera_choice(const std::filesystem::path& path, const StreamChoice& choice = {});

}  // namespace idol
