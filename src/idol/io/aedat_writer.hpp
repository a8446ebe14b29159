// iniVation AEDAT 4.0 files: events and IMU.
#pragma once

#include <string_view>
#include <vector>

#include "idol/io/block_codec.hpp"
#include "idol/io/file_writer.hpp"
#include "idol/io/flat_builder.hpp"
#include "idol/io/recording_writer.hpp"

namespace idol {

/// The format knows whole microseconds, accelerations in g and rates in deg/s with 24 bits: stamps are cut to
/// microseconds. It has no place for ground truth.
class AedatWriter : public RecordingWriter {
 public:
  /// Throws DataError if the file cannot be created.
  AedatWriter(const std::filesystem::path& path, const WriterOptions& options, BlockCodec codec);

  void add(const Packet& packet) override;
  bool add_groundtruth(const Trajectory&) override { return false; }
  void close() override;

 private:
  /// For the table at the file's end.
  struct Entry {
    std::uint64_t place = 0;
    std::int32_t stream = 0, size = 0;
    std::int64_t count = 0, first_us = 0, last_us = 0;
  };
  void write_header(std::int64_t table_place);
  void write_table();
  void write_packet(std::int32_t stream, FlatBuilder& packet, std::int64_t count, Time first, Time last);

  FileWriter file_;
  WriterOptions options_;
  BlockCodec codec_;
  std::vector<Entry> entries_;
};

}  // namespace idol
