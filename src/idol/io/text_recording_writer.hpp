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
  /// Creates the folder; with `compress`, events.txt.zst. Throws DataError if it cannot be written.
  TextRecordingWriter(const std::filesystem::path& folder, bool compress);

  void add(const Packet& packet) override;
  bool add_groundtruth(const Trajectory& truth) override;
  void close() override;
  void add(std::span<const Event> events);
  void add(const ImuSample& sample);

 private:
  std::filesystem::path folder_;
  bool compress_;
  std::optional<TextWriter> events_, imu_;  ///< as soon as there is something to write
};

}  // namespace idol
