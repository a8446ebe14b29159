#include <gtest/gtest.h>

#include <cstring>

#include "idol/base/diagnostics.hpp"
#include "idol/io/bag_messages.hpp"
#include "idol/io/bag_writer.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

TEST(Bag, WrittenAndReadBack) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.bag";
  const Packet packet = some_packet();
  const Trajectory truth = some_truth();
  for (const BlockCodec codec : {BlockCodec::kNone, BlockCodec::kLz4, BlockCodec::kBzip2}) {
    BagWriter writer(path, {240, 180}, codec);
    writer.add(packet);
    EXPECT_TRUE(writer.add_groundtruth(truth));
    writer.close();
    const ReadBack r = read_back(path);
    expect_same(r, packet);
    EXPECT_TRUE(r.warnings.empty());
    const auto recording = open_recording(path);
    EXPECT_EQ(recording->resolution().width, 240);
    EXPECT_EQ(recording->resolution().height, 180);
    const auto poses = recording->groundtruth();
    ASSERT_TRUE(poses);
    ASSERT_EQ(poses->size(), truth.size());
    for (std::size_t i = 0; i < truth.size(); ++i) {
      EXPECT_EQ((*poses)[i].t, truth[i].t);
      EXPECT_LT(((*poses)[i].T.p - truth[i].T.p).norm(), 1e-12);
      EXPECT_LT((*poses)[i].T.q.angularDistance(truth[i].T.q), 1e-7);
    }
  }
}

TEST(Bag, TopicsByTypeOrByName) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.bag";
  write(path, {some_packet()}, false, some_truth());
  StreamChoice choice;
  choice.events = "/dvs/events";
  choice.imu = "/dvs/imu";
  expect_same(read_back(path, choice), some_packet());
  choice.events = "/other/events";
  expect_says(read_back(path, choice).error, {"r.bag", "--events-topic", "/dvs/events"});
  EXPECT_EQ(open_recording(path)->streams().size(), 3u);
}

TEST(Bag, WithoutIndex) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.bag";
  for (const bool compress : {false, true}) {
    write(path,
          {some_packet(0), some_packet(1), some_packet(2), some_packet(3), some_packet(4), some_packet(5),
           some_packet(6), some_packet(7), some_packet(8), some_packet(9), some_packet(10), some_packet(11)},
          compress);
    const std::string whole = slurp(path);
    const ReadBack r = read_back(dir.write("cut.bag", whole.substr(0, whole.size() * 9 / 10)));
    expect_says(r.error, {"cut.bag", "byte"});
    EXPECT_EQ(r.warnings.count("bag_without_index"), 1u);
    EXPECT_GE(r.events.size(), compress ? 40000u : 50000u);  // a compressed chunk is whole or lost
    EXPECT_LT(r.events.size(), 60000u);
  }
}

TEST(Bag, DamageIsToldOfAndDoesNoHarm) {
  const TempDir dir;
  for (const bool compress : {false, true}) {
    write(dir.path() / "r.bag", {some_packet(0), some_packet(1)}, compress, some_truth());
    expect_survives_damage(dir, slurp(dir.path() / "r.bag"));
  }
}

TEST(Bag, StampsOutsideRosTime) {
  const TempDir dir;
  BagWriter writer(dir.path() / "r.bag", {}, BlockCodec::kNone);
  Packet packet;
  packet.events.push_back({-5, 1, 1, true});
  EXPECT_THROW(writer.add(packet), DataError);
}

// --- messages that the writer does not write ---

class Message {
 public:
  template <class T>
  Message& put(T value) {
    const auto* p = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), p, p + sizeof(T));
    return *this;
  }
  Message& text(const std::string& s) {
    put(static_cast<std::uint32_t>(s.size()));
    bytes_.insert(bytes_.end(), s.begin(), s.end());
    return *this;
  }
  Message& header(std::uint32_t s, std::uint32_t ns) {
    return put<std::uint32_t>(0).put(s).put(ns).text("frame");
  }
  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

Message event_packet(const std::string& encoding, std::uint64_t time_base) {
  Message m;
  m.header(10, 500).put<std::uint32_t>(720).put<std::uint32_t>(1280);
  return m.put<std::uint64_t>(1).put(time_base).text(encoding).put<std::uint8_t>(0);
}

TEST(BagMessages, EventPacketMono) {
  Message m = event_packet("mono", 0);
  const auto word = [](std::uint64_t dt, std::uint64_t x, std::uint64_t y, std::uint64_t p) {
    return dt | x << 32 | y << 48 | p << 63;
  };
  m.put<std::uint32_t>(16).put(word(7, 1279, 3, 1)).put(word(4'000'000'000, 5, 719, 0));
  EventMessageDecoder decoder("event_camera_msgs/EventPacket");
  std::vector<Event> events;
  decoder.decode(m.bytes(), events);
  EXPECT_EQ(decoder.width(), 1280u);
  const Time t = 10'000'000'500;
  EXPECT_EQ(events, (std::vector<Event>{{t + 7, 1279, 3, true}, {t + 4'000'000'000, 5, 719, false}}));
}

TEST(BagMessages, EventPacketEvt3) {
  const auto packet = [](std::initializer_list<std::uint16_t> words) {
    Message m = event_packet("evt3", 0);
    m.put(static_cast<std::uint32_t>(2 * words.size()));
    for (const std::uint16_t word : words) m.put(word);
    return m;
  };
  EventMessageDecoder decoder("event_camera_msgs/EventPacket");
  std::vector<Event> events;
  // High time 0xfff, low 0xffe: y 9, event at x 33 ON; a vector from x 100 with bits 0 and 11.
  decoder.decode(packet({0x8fff, 0x6ffe, 0x0009, 0x2821, 0x3064, 0x4801}).bytes(), events);
  const Time t = 10'000'000'500;
  EXPECT_EQ(events, (std::vector<Event>{{t, 33, 9, true}, {t, 100, 9, false}, {t, 111, 9, false}}));
  // The clock of 24 bits has overflown, 3 us later; x goes on behind the vector, in another message.
  decoder.decode(packet({0x8000, 0x6001, 0x5081}).bytes(), events);
  EXPECT_EQ(events, (std::vector<Event>{{t + 3000, 112, 9, false}, {t + 3000, 119, 9, false}}));
}

TEST(BagMessages, PropheseeArrayAndPoses) {
  Message m;
  m.header(1, 2).put<std::uint32_t>(4).put<std::uint32_t>(5).put<std::uint32_t>(1);
  m.put<std::uint16_t>(3).put<std::uint16_t>(2).put<std::uint32_t>(9).put<std::uint32_t>(8).put<std::uint8_t>(
      1);
  std::vector<Event> events;
  EventMessageDecoder("prophesee_event_msgs/EventArray").decode(m.bytes(), events);
  EXPECT_EQ(events, (std::vector<Event>{{9'000'000'008, 3, 2, true}}));

  for (const char* type :
       {"geometry_msgs/TransformStamped", "nav_msgs/Odometry", "geometry_msgs/PoseStamped"}) {
    Message pose;
    pose.header(3, 4);
    if (std::strcmp(type, "geometry_msgs/PoseStamped") != 0) pose.text("child");
    for (const double v : {1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8}) pose.put(v);
    const StampedPose read = decode_pose(pose.bytes(), type);
    EXPECT_EQ(read.t, 3'000'000'004);
    EXPECT_EQ(read.T.p, Vec3(1, 2, 3));
    EXPECT_NEAR(read.T.q.w(), 0.8, 1e-12);
    for (std::size_t size = 0; size < pose.bytes().size(); ++size)
      EXPECT_THROW(decode_pose(Bytes(pose.bytes()).first(size), type), BadBytes);
  }
}

TEST(BagMessages, Images) {
  const auto image = [](const std::string& encoding, std::uint32_t stride, std::initializer_list<int> bytes) {
    Message m;
    m.header(5, 6).put<std::uint32_t>(2).put<std::uint32_t>(2).text(encoding).put<std::uint8_t>(0).put(
        stride);
    m.put(static_cast<std::uint32_t>(bytes.size()));
    for (const int byte : bytes) m.put(static_cast<std::uint8_t>(byte));
    return m.bytes();
  };
  using Grey = std::vector<std::uint8_t>;
  Frame frame;
  decode_image(image("mono8", 3, {1, 2, 99, 3, 4, 99}), frame);
  EXPECT_EQ(frame.t, 5'000'000'006);
  EXPECT_EQ(frame.width, 2);
  EXPECT_EQ(frame.grey, (Grey{1, 2, 3, 4}));
  decode_image(image("bgr8", 6, {3, 6, 9, 0, 0, 3, 255, 255, 255, 1, 1, 1}), frame);
  EXPECT_EQ(frame.grey, (Grey{6, 1, 255, 1}));
  decode_image(image("mono16", 4, {7, 1, 7, 2, 7, 3, 7, 4}), frame);
  EXPECT_EQ(frame.grey, (Grey{1, 2, 3, 4}));
  EXPECT_THROW(decode_image(image("mono8", 2, {1, 2, 3}), frame), BadBytes);
  EXPECT_THROW(decode_image(image("mono8", 1, {1, 2, 3, 4}), frame), BadBytes);
  EXPECT_THROW(decode_image(image("yuv422", 4, {1, 2, 3, 4, 5, 6, 7, 8}), frame), UnknownFormat);
}

TEST(BagMessages, UnknownEncoding) {
  Message m = event_packet("evt2", 0);
  m.put<std::uint32_t>(0);
  std::vector<Event> events;
  EventMessageDecoder decoder("event_camera_msgs/EventPacket");
  EXPECT_THROW(decoder.decode(m.bytes(), events), UnknownFormat);
}

}  // namespace
}  // namespace idol::test
