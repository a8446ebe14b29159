// ROS 1 bags (version 2.0) with the topics of the RPG Event-Camera Dataset.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "idol/io/block_codec.hpp"
#include "idol/io/file_writer.hpp"
#include "idol/io/recording_writer.hpp"

namespace idol {

/// Events as dvs_msgs/EventArray on /dvs/events, IMU as sensor_msgs/Imu on /dvs/imu, truth as
/// geometry_msgs/PoseStamped on /optitrack/davis. Stamps must lie in ROS time: not negative, below 2^32 s.
class BagWriter : public RecordingWriter {
 public:
  /// `codec`: none, LZ4 or bzip2. Throws DataError if the file cannot be created.
  BagWriter(const std::filesystem::path& path, const WriterOptions& options, BlockCodec codec);

  void add(const Packet& packet) override;
  bool add_groundtruth(const Trajectory& truth) override;
  void close() override;

 private:
  using Buffer = std::vector<std::uint8_t>;
  /// A message in the chunk being filled: its time, and its place there.
  struct Index {
    Time time = 0;
    std::uint32_t place = 0;
  };
  struct ChunkInfo {
    std::uint64_t place = 0;
    Time first = 0, last = 0;
    std::map<std::uint32_t, std::uint32_t> counts;  // of messages, by connection
  };
  /// Begins a message with its std_msgs/Header. Throws DataError if ROS has no such time.
  void begin_message(std::uint32_t connection, Time stamp);
  /// Puts the message into the chunk.
  void end_message(std::uint32_t connection, Time stamp);
  void finish_chunk();
  void write_bag_header(std::uint64_t index_place, std::uint32_t connections);

  FileWriter file_;
  WriterOptions options_;
  BlockCodec codec_;
  Buffer chunk_, message_;
  std::map<std::uint32_t, std::vector<Index>> index_;  // of the chunk, by connection
  std::map<std::uint32_t, std::uint32_t> messages_;    // written so far, by connection
  std::vector<ChunkInfo> chunks_;
};

}  // namespace idol
