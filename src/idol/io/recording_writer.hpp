// Recordings written to disk, one derived class a format.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "idol/base/types.hpp"

namespace idol {

class RecordingWriter {
 public:
  virtual ~RecordingWriter() = default;
  /// Events and IMU samples, each stream in time order. Throws DataError if the disk refuses, or if the
  /// format cannot hold a value.
  virtual void add(const Packet& packet) = 0;
  /// Poses of the camera in the world, at most once. False: the format has no place for them.
  virtual bool add_groundtruth(const Trajectory& truth) = 0;
  /// The end of the recording; only then is it whole. Throws DataError if the disk refuses.
  virtual void close() = 0;
};

enum class RecordingFormat { kText, kBag, kHdf5, kAedat4 };

struct WriterOptions {
  int width = 0, height = 0;  ///< of the sensor, for formats that state it; 0 = unknown
  bool compress = false;      ///< smaller and slower
};

/// By the name's ending: .bag, .h5 or .hdf5, .aedat4; without one of these a folder of text files.
RecordingFormat format_of_name(const std::filesystem::path& path);

/// Creates the file, or the folder. Throws DataError if it cannot be written.
std::unique_ptr<RecordingWriter> create_recording(const std::filesystem::path& path, RecordingFormat format,
                                                  const WriterOptions& options);

}  // namespace idol
