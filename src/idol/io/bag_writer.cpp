#include "idol/io/bag_writer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <string_view>

#include "idol/base/diagnostics.hpp"
#include "idol/io/ros_types.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {
namespace {

using Buffer = std::vector<std::uint8_t>;

constexpr std::size_t kChunkBytes = 768 << 10;  // as rosbag does
constexpr std::size_t kBagHeaderBytes = 4096;
constexpr std::string_view kMagic = "#ROSBAG V2.0\n";
constexpr std::uint32_t kEvents = 0, kImu = 1, kPose = 2;

struct Topic {
  const char *name, *type;
};
constexpr Topic kTopics[] = {{"/dvs/events", "dvs_msgs/EventArray"},
                             {"/dvs/imu", "sensor_msgs/Imu"},
                             {"/optitrack/davis", "geometry_msgs/PoseStamped"}};

void put_bytes(Buffer& out, const void* data, std::size_t size) {
  if (size == 0) return;  // an empty vector's data may be null
  const std::size_t at = out.size();
  out.resize(at + size);
  std::memcpy(out.data() + at, data, size);
}

template <class T>
void put(Buffer& out, T value) {
  put_bytes(out, &value, sizeof(T));
}

void put_text(Buffer& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  put_bytes(out, text.data(), text.size());
}

void put_stamp(Buffer& out, Time t) {
  put(out, static_cast<std::uint32_t>(t / 1'000'000'000));
  put(out, static_cast<std::uint32_t>(t % 1'000'000'000));
}

void put_vec3(Buffer& out, const Vec3& v) {
  for (const double value : {v.x(), v.y(), v.z()}) put(out, value);
}

void put_quaternion(Buffer& out, const Quat& q) {
  for (const double value : {q.x(), q.y(), q.z(), q.w()}) put(out, value);
}

/// The fields of a record's header.
class Fields {
 public:
  Fields() = default;  ///< none: for data that are made like a header
  explicit Fields(std::uint8_t op) { add("op", op); }
  template <class T>
  Fields& add(std::string_view name, T value) {
    Buffer bytes;
    put(bytes, value);
    return add_bytes(name, bytes);
  }
  Fields& add(std::string_view name, std::string_view value) {
    return add_bytes(name, {value.begin(), value.end()});
  }
  Fields& add_time(std::string_view name, Time t) {
    Buffer bytes;
    put_stamp(bytes, t);
    return add_bytes(name, bytes);
  }
  [[nodiscard]] const Buffer& bytes() const { return bytes_; }

 private:
  Fields& add_bytes(std::string_view name, const Buffer& value) {
    put(bytes_, static_cast<std::uint32_t>(name.size() + 1 + value.size()));
    put_bytes(bytes_, name.data(), name.size());
    bytes_.push_back('=');
    put_bytes(bytes_, value.data(), value.size());
    return *this;
  }
  Buffer bytes_;
};

void put_record(Buffer& out, const Fields& fields, const Buffer& data) {
  put(out, static_cast<std::uint32_t>(fields.bytes().size()));
  put_bytes(out, fields.bytes().data(), fields.bytes().size());
  put(out, static_cast<std::uint32_t>(data.size()));
  put_bytes(out, data.data(), data.size());
}

void put_connection(Buffer& out, std::uint32_t connection) {
  const std::string_view name = kTopics[connection].name;
  const RosType& type = *find_ros_type(kTopics[connection].type);
  Fields data;
  data.add("topic", name).add("type", type.name).add("md5sum", type.md5sum);
  data.add("message_definition", type.definition);
  put_record(out, Fields(7).add("conn", connection).add("topic", name), data.bytes());
}

std::string_view codec_name(BlockCodec codec) {
  switch (codec) {
    case BlockCodec::kNone:
      return "none";
    case BlockCodec::kLz4:
      return "lz4";
    case BlockCodec::kBzip2:
      return "bz2";
    case BlockCodec::kZstd:
      break;
  }
  throw UsageError("ROS 1 bags are compressed with LZ4, bzip2 or not at all");
}

}  // namespace

BagWriter::BagWriter(const std::filesystem::path& path, const WriterOptions& options, BlockCodec codec)
    : file_(path), options_(options), codec_(codec) {
  file_.write(kMagic.data(), kMagic.size());
  write_bag_header(0, 0);
}

/// Of fixed length, since it is written again at the end.
void BagWriter::write_bag_header(std::uint64_t index_place, std::uint32_t connections) {
  const Fields fields = Fields(3)
                            .add("index_pos", index_place)
                            .add("conn_count", connections)
                            .add("chunk_count", static_cast<std::uint32_t>(chunks_.size()));
  Buffer record;
  put_record(record, fields, Buffer(kBagHeaderBytes - 8 - fields.bytes().size(), ' '));
  file_.write(record.data(), record.size());
}

void BagWriter::begin_message(std::uint32_t connection, Time stamp) {
  if (stamp < 0 || stamp / 1'000'000'000 > 0xffffffff)
    throw DataError(
        fmt::format("the stamp {} s cannot be written to a ROS bag: ROS time begins at 0 and ends "
                    "at 2^32 s",
                    format_stamp(stamp)));
  message_.clear();
  put(message_, messages_[connection]);
  put_stamp(message_, stamp);
  put_text(message_, {});
}

void BagWriter::end_message(std::uint32_t connection, Time stamp) {
  if (messages_[connection]++ == 0) put_connection(chunk_, connection);
  index_[connection].push_back({stamp, static_cast<std::uint32_t>(chunk_.size())});
  put_record(chunk_, Fields(2).add("conn", connection).add_time("time", stamp), message_);
  if (chunk_.size() >= kChunkBytes) finish_chunk();
}

void BagWriter::add(const Packet& packet) {
  if (!packet.events.empty()) {
    const Time stamp = packet.events.front().t;
    begin_message(kEvents, stamp);
    put(message_, static_cast<std::uint32_t>(options_.height));
    put(message_, static_cast<std::uint32_t>(options_.width));
    put(message_, static_cast<std::uint32_t>(packet.events.size()));
    for (const Event& e : packet.events) {
      put(message_, e.x);
      put(message_, e.y);
      put_stamp(message_, e.t);
      put(message_, static_cast<std::uint8_t>(e.polarity ? 1 : 0));
    }
    end_message(kEvents, stamp);
  }
  for (const ImuSample& s : packet.imu) {
    constexpr double kUnknown[9] = {-1};  // of a covariance: ROS's sign for "no such measurement"
    constexpr double kNotStated[9] = {};
    begin_message(kImu, s.t);
    put_quaternion(message_, Quat::Identity());
    put_bytes(message_, kUnknown, sizeof(kUnknown));
    put_vec3(message_, s.gyro);
    put_bytes(message_, kNotStated, sizeof(kNotStated));
    put_vec3(message_, s.accel);
    put_bytes(message_, kNotStated, sizeof(kNotStated));
    end_message(kImu, s.t);
  }
}

bool BagWriter::add_groundtruth(const Trajectory& truth) {
  for (const auto& [t, T] : truth) {
    begin_message(kPose, t);
    put_vec3(message_, T.p);
    put_quaternion(message_, T.q);
    end_message(kPose, t);
  }
  return true;
}

void BagWriter::finish_chunk() {
  if (chunk_.empty()) return;
  ChunkInfo info{file_.place(), index_.begin()->second[0].time, index_.begin()->second[0].time, {}};
  const auto size = static_cast<std::uint32_t>(chunk_.size());
  Buffer records;
  put_record(records, Fields(5).add("compression", codec_name(codec_)).add("size", size),
             compress(codec_, chunk_));
  for (auto& [connection, entries] : index_) {
    const auto count = static_cast<std::uint32_t>(entries.size());
    Buffer data;
    for (const Index& entry : entries) {
      put_stamp(data, entry.time);
      put(data, entry.place);
      info.first = std::min(info.first, entry.time);
      info.last = std::max(info.last, entry.time);
    }
    put_record(records, Fields(4).add("ver", std::uint32_t{1}).add("conn", connection).add("count", count),
               data);
    info.counts[connection] = count;
  }
  file_.write(records.data(), records.size());
  chunks_.push_back(info);
  chunk_.clear();
  index_.clear();
}

void BagWriter::close() {
  finish_chunk();
  const std::uint64_t index_place = file_.place();
  Buffer records;
  for (const auto& [connection, count] : messages_) put_connection(records, connection);
  for (const ChunkInfo& chunk : chunks_) {
    Buffer data;
    for (const auto& [connection, count] : chunk.counts) {
      put(data, connection);
      put(data, count);
    }
    put_record(records,
               Fields(6)
                   .add("ver", std::uint32_t{1})
                   .add("chunk_pos", chunk.place)
                   .add_time("start_time", chunk.first)
                   .add_time("end_time", chunk.last)
                   .add("count", static_cast<std::uint32_t>(chunk.counts.size())),
               data);
  }
  file_.write(records.data(), records.size());
  file_.seek(kMagic.size());
  write_bag_header(index_place, static_cast<std::uint32_t>(messages_.size()));
  file_.close();
}

}  // namespace idol
