#include "idol/io/bag_messages.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace idol {
namespace {

constexpr std::array<std::string_view, 3> kEventTypes = {
    "dvs_msgs/EventArray", "prophesee_event_msgs/EventArray", "event_camera_msgs/EventPacket"};
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

void EventMessageDecoder::decode_packet(ByteCursor cursor, Time header_stamp, std::vector<Event>& events) {
  cursor.get<std::uint64_t>();  // seq
  cursor.get<std::uint64_t>();  // time_base: of the sensor's clock
  const std::string_view encoding = cursor.text();
  if (cursor.get<std::uint8_t>() != 0) throw BadBytes{"its events are big-endian, which is not supported"};
  const Bytes bytes = cursor.take(cursor.get<std::uint32_t>());
  if (encoding == "mono") {
    decode_mono(bytes, header_stamp, events);
  } else if (encoding == "evt3") {
    decode_evt3(bytes, header_stamp, events);
  } else {
    throw BadBytes{"its events are encoded neither as 'mono' nor as 'evt3'"};
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
/// microseconds in 24 bits; the first message's header stamp ties it to ROS time.
void EventMessageDecoder::decode_evt3(Bytes bytes, Time stamp, std::vector<Event>& events) {
  if (bytes.size() % 2 != 0) throw BadBytes{"its events are no multiple of 2 bytes"};
  constexpr std::int64_t kHighStep = 1 << 12, kWrap = 1 << 24;
  const auto add = [&](std::uint16_t x) {
    if (time_us_ < 0) return;  // before the first stamp
    if (!sensor_to_ros_) sensor_to_ros_ = stamp - time_us_ * 1000;
    events.push_back({*sensor_to_ros_ + time_us_ * 1000, x, y_, polarity_});
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
      case 0x6:
        if (time_high_us_ >= 0) time_us_ = time_high_us_ + (word & 0xfff);
        break;
      case 0x8: {
        std::int64_t high = (word & 0xfff) * kHighStep;
        if (time_high_us_ >= 0) {
          high += time_high_us_ / kWrap * kWrap;
          if (high < time_high_us_ - kWrap / 2) high += kWrap;  // the 24 bits have overflown
        }
        time_high_us_ = high;
        break;
      }
      default:  // triggers and others
        break;
    }
  }
}

ImuSample decode_imu(Bytes message) {
  constexpr std::size_t kCovariance = 9 * sizeof(double);
  ByteCursor cursor(message);
  ImuSample sample;
  sample.t = get_header(cursor);
  cursor.take(4 * sizeof(double) + kCovariance);  // orientation
  sample.gyro = get_vec3(cursor);
  cursor.take(kCovariance);
  sample.accel = get_vec3(cursor);
  return sample;
}

StampedPose decode_pose(Bytes message, std::string_view type) {
  ByteCursor cursor(message);
  StampedPose pose;
  pose.t = get_header(cursor);
  if (type != kPoseType) cursor.text();  // child_frame_id
  pose.T.p = get_vec3(cursor);
  const Vec3 v = get_vec3(cursor);
  const Quat q(cursor.get<double>(), v.x(), v.y(), v.z());
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
  if (channels == 0) throw BadBytes{"its picture is encoded in a way that is not known here"};
  const bool wide = encoding.find("16") != std::string_view::npos;
  fill_grey(frame, bytes, width, height, stride, channels, wide ? 2 : 1);
}

}  // namespace idol
