// Recordings in the layout of the RPG Event-Camera Dataset: a folder of text files.
#pragma once

#include <filesystem>
#include <optional>
#include <span>

#include "idol/io/recording_writer.hpp"
#include "idol/io/text_writer.hpp"

namespace idol {

class TextRecordingWriter : public RecordingWriter {
 public:
  /// Claims the folder; with `compress`, events.txt.zst. What an earlier recording left in it is replaced,
  /// and removed, by close(). Throws DataError if it cannot be written, UsageError if it holds anything else.
  TextRecordingWriter(const std::filesystem::path& folder, bool compress);

  void add(const Packet& packet) override;
  bool add_groundtruth(const Trajectory& truth) override;
  void close() override;
  void add(std::span<const Event> events);
  void add(const ImuSample& sample);

 private:
  std::filesystem::path folder_;
  bool compress_;
  Trajectory truth_;
  std::optional<TextWriter> events_, imu_;  ///< as soon as there is something to write
};

}  // namespace idol
