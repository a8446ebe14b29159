#include "idol/io/bag_messages.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

constexpr std::array<std::string_view, 3> kEventTypes = {
    "dvs_msgs/EventArray", "prophesee_event_msgs/EventArray", "event_camera_msgs/EventPacket"};
// Words of evt3 that are of time.
constexpr int kEvt3Low = 0x6, kEvt3High = 0x8;
constexpr std::int64_t kEvt3HighStep = 1 << 12;  // [us]

constexpr std::string_view kOdometryType = "nav_msgs/Odometry",
                           kTransformType = "geometry_msgs/TransformStamped",
                           kPoseType = "geometry_msgs/PoseStamped";

Time get_stamp(ByteCursor& cursor) {
  const auto seconds = cursor.get<std::uint32_t>();
  return Time{seconds} * 1'000'000'000 + cursor.get<std::uint32_t>();
}

/// std_msgs/Header.
Time get_header(ByteCursor& cursor) {
  cursor.get<std::uint32_t>();
  const Time stamp = get_stamp(cursor);
  cursor.text();
  return stamp;
}

Vec3 get_vec3(ByteCursor& cursor) {
  const auto x = cursor.get<double>(), y = cursor.get<double>(), z = cursor.get<double>();
  return {x, y, z};
}

}  // namespace

bool is_event_type(std::string_view type) {
  return std::find(kEventTypes.begin(), kEventTypes.end(), type) != kEventTypes.end();
}
bool is_imu_type(std::string_view type) { return type == "sensor_msgs/Imu"; }
bool is_image_type(std::string_view type) { return type == "sensor_msgs/Image"; }
bool is_pose_type(std::string_view type) {
  return type == kPoseType || type == kTransformType || type == kOdometryType;
}

EventMessageDecoder::EventMessageDecoder(std::string_view type)
    : packed_(type == "event_camera_msgs/EventPacket") {}

void EventMessageDecoder::decode(Bytes message, std::vector<Event>& events) {
  events.clear();
  ByteCursor cursor(message);
  const Time stamp = get_header(cursor);
  height_ = cursor.get<std::uint32_t>();
  width_ = cursor.get<std::uint32_t>();
  if (packed_) {
    if (!clock_.known()) add_to_clock(message, clock_);
    decode_packet(cursor, stamp, events);
  } else {
    decode_array(cursor, events);
  }
}

/// Event[]: uint16 x, uint16 y, time ts, bool polarity.
void EventMessageDecoder::decode_array(ByteCursor cursor, std::vector<Event>& events) const {
  constexpr std::size_t kSize = 13;
  const auto count = cursor.get<std::uint32_t>();
  const Bytes bytes = cursor.take(count * kSize);
  events.resize(count);
  const std::uint8_t* p = bytes.data();
  for (Event& e : events) {
    std::uint32_t seconds = 0, nanoseconds = 0;
    std::memcpy(&e.x, p, 2);
    std::memcpy(&e.y, p + 2, 2);
    std::memcpy(&seconds, p + 4, 4);
    std::memcpy(&nanoseconds, p + 8, 4);
    e.t = Time{seconds} * 1'000'000'000 + nanoseconds;
    e.polarity = p[12] != 0;
    p += kSize;
  }
}

namespace {

/// What an event_camera_msgs/EventPacket holds behind its size.
struct EventPacket {
  std::string_view encoding;
  Bytes bytes;

  explicit EventPacket(ByteCursor& cursor) {
    cursor.get<std::uint64_t>();  // seq
    cursor.get<std::uint64_t>();  // time_base: of the sensor's clock
    encoding = cursor.text();
    if (cursor.get<std::uint8_t>() != 0)
      throw UnknownFormat(
          "the events are big-endian, which is not read; record them on a little-endian machine");
    bytes = cursor.take(cursor.get<std::uint32_t>());
  }
};

constexpr std::string_view kMono = "mono", kEvt3 = "evt3";

}  // namespace

void EventMessageDecoder::decode_packet(ByteCursor cursor, Time header_stamp, std::vector<Event>& events) {
  const EventPacket packet(cursor);
  if (packet.encoding == kMono) {
    decode_mono(packet.bytes, header_stamp, events);
  } else if (packet.encoding == kEvt3) {
    decode_evt3(packet.bytes, header_stamp, events);
  } else {
    throw UnknownFormat(fmt::format(
        "the events are in {} encoding, which is not read; record or convert them with mono or evt3",
        printable(packet.encoding)));
  }
}

void EventMessageDecoder::add_to_clock(Bytes message, SensorClock& clock) {
  ByteCursor cursor(message);
  const Time stamp = get_header(cursor);
  cursor.get<std::uint64_t>();  // height and width
  const EventPacket packet(cursor);
  if (packet.encoding != kEvt3) return;
  std::optional<std::int64_t> high;
  for (std::size_t i = 0; i + 1 < packet.bytes.size(); i += 2) {
    const auto word = load<std::uint16_t>(packet.bytes, i);
    if (word >> 12 == kEvt3High) high = (word & 0xfff) * kEvt3HighStep;
    if (word >> 12 == kEvt3Low && high) return clock.add(stamp, *high + (word & 0xfff));
  }
}

/// 64 bits an event: polarity 1, y 15, x 16, nanoseconds since the header's stamp 32.
void EventMessageDecoder::decode_mono(Bytes bytes, Time stamp, std::vector<Event>& events) const {
  if (bytes.size() % 8 != 0) throw BadBytes{"its events are no multiple of 8 bytes"};
  events.reserve(bytes.size() / 8);
  for (std::size_t i = 0; i < bytes.size(); i += 8) {
    const auto word = load<std::uint64_t>(bytes, i);
    events.push_back({stamp + static_cast<Time>(word & 0xffffffff), static_cast<std::uint16_t>(word >> 32),
                      static_cast<std::uint16_t>((word >> 48) & 0x7fff), (word >> 63) != 0});
  }
}

/// Prophesee EVT 3.0: words of 16 bits, the upper four of which say what the others are. Its clock counts
/// microseconds in 24 bits.
void EventMessageDecoder::decode_evt3(Bytes bytes, Time stamp, std::vector<Event>& events) {
  if (bytes.size() % 2 != 0) throw BadBytes{"its events are no multiple of 2 bytes"};
  bool first_high = true;
  const auto add = [&](std::uint16_t x) {
    if (time_) events.push_back({*time_, x, y_, polarity_});  // none before the first stamp
  };
  const auto add_vector = [&](unsigned valid, std::uint16_t length) {
    for (std::uint16_t i = 0; i < length; ++i)
      if ((valid >> i & 1U) != 0) add(static_cast<std::uint16_t>(x_ + i));
    x_ = static_cast<std::uint16_t>(x_ + length);
  };
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const auto word = load<std::uint16_t>(bytes, i);
    switch (word >> 12) {
      case 0x0:
        y_ = word & 0x7ff;
        break;
      case 0x2:
        polarity_ = (word & 0x800) != 0;
        add(word & 0x7ff);
        break;
      case 0x3:
        polarity_ = (word & 0x800) != 0;
        x_ = word & 0x7ff;
        break;
      case 0x4:
        add_vector(word & 0xfff, 12);
        break;
      case 0x5:
        add_vector(word & 0xff, 8);
        break;
      case kEvt3Low:
        if (high_us_) time_ = high_ + (word & 0xfff) * 1000;
        break;
      case kEvt3High:
        set_time_high((word & 0xfff) * kEvt3HighStep, stamp, std::exchange(first_high, false));
        break;
      default:  // triggers and others
        break;
    }
  }
}

/// Within a message time goes on from what it was, be it over the end of the 24 bits; between messages any
/// number may be lost, and the stamp tells how often the clock has wrapped.
void EventMessageDecoder::set_time_high(std::int64_t high_us, Time stamp, bool first_of_message) {
  constexpr Time kAnySilence = 86'400'000'000'000;  // beyond a day it is the stamp that is wrong
  const Time by_stamp = clock_.ros_time(high_us, stamp);
  if (!high_us_) {
    high_ = by_stamp;
  } else {
    constexpr std::int64_t kWrapUs = SensorClock::kWrap / 1000;
    std::int64_t step = high_us - *high_us_;
    if (step < -kWrapUs / 2) step += kWrapUs;
    high_ += step * 1000;
    if (first_of_message && by_stamp - high_ < kAnySilence && high_ - by_stamp < kAnySilence)
      high_ = by_stamp;
  }
  high_us_ = high_us;
}

ImuSample decode_imu(Bytes message, ImuPart part, bool* doubtful) {
  // Of a covariance, the first entry is -1 where the message has no such readings.
  const auto not_provided = [](ByteCursor& cursor) {
    const auto first = cursor.get<double>();
    cursor.take(8 * sizeof(double));
    return first == -1;
  };
  ByteCursor cursor(message);
  ImuSample sample;
  sample.t = get_header(cursor);
  cursor.take((4 + 9) * sizeof(double));  // orientation and its covariance
  sample.gyro = get_vec3(cursor);
  const bool no_gyro = not_provided(cursor) && part != ImuPart::kAccel;
  sample.accel = get_vec3(cursor);
  const bool no_accel = not_provided(cursor) && part != ImuPart::kGyro;
  const bool gyro_missing = no_gyro && sample.gyro.isZero(0),
             accel_missing = no_accel && sample.accel.isZero(0);
  if (gyro_missing || accel_missing)
    throw UnknownFormat(
        fmt::format("the IMU's messages have no {} (their covariance begins with -1); choose another "
                    "topic with --imu-topic, or two as ACCEL,GYRO",
                    gyro_missing && accel_missing ? "readings"
                    : gyro_missing                ? "rates"
                                                  : "accelerations"));
  if (doubtful != nullptr) *doubtful = no_gyro || no_accel;
  return sample;
}

StampedPose decode_pose(Bytes message, std::string_view type, bool* lost) {
  ByteCursor cursor(message);
  StampedPose pose;
  pose.t = get_header(cursor);
  if (type != kPoseType) cursor.text();  // child_frame_id
  pose.T.p = get_vec3(cursor);
  const Vec3 v = get_vec3(cursor);
  const Quat q(cursor.get<double>(), v.x(), v.y(), v.z());
  if (lost != nullptr) *lost = !pose.T.p.allFinite() || !q.coeffs().allFinite() || q.coeffs().isZero(0);
  if (lost != nullptr && *lost) return pose;
  constexpr double kTolerance = 0.05;
  if (!pose.T.p.allFinite() || !(std::abs(q.norm() - 1.0) <= kTolerance))
    throw BadBytes{"its pose is not finite, or its quaternion is not of length 1"};
  pose.T.q = q.normalized();
  return pose;
}

void decode_image(Bytes message, Frame& frame) {
  ByteCursor cursor(message);
  frame.t = get_header(cursor);
  const auto height = cursor.get<std::uint32_t>(), width = cursor.get<std::uint32_t>();
  const std::string_view encoding = cursor.text();
  cursor.get<std::uint8_t>();  // byte order
  const auto stride = cursor.get<std::uint32_t>();
  const Bytes bytes = cursor.take(cursor.get<std::uint32_t>());
  std::size_t channels = 0;
  if (encoding.starts_with("mono") || encoding.starts_with("bayer_") || encoding.ends_with("C1"))
    channels = 1;
  if (encoding.starts_with("rgb") || encoding.starts_with("bgr") || encoding.ends_with("C3")) channels = 3;
  if (encoding.starts_with("rgba") || encoding.starts_with("bgra") || encoding.ends_with("C4")) channels = 4;
  if (channels == 0)
    throw UnknownFormat(
        fmt::format("the pictures are in {} encoding, which is not read", printable(encoding)));
  const bool wide = encoding.find("16") != std::string_view::npos;
  fill_grey(frame, bytes, width, height, stride, channels, wide ? 2 : 1);
}

}  // namespace idol
