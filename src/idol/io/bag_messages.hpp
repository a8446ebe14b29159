// What the messages of a bag mean: ROS 1 serialisation of the types that an odometry reads.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/io/bytes.hpp"
#include "idol/io/frame.hpp"

namespace idol {

/// What a message type is good for.
bool is_event_type(std::string_view type);
bool is_imu_type(std::string_view type);
bool is_pose_type(std::string_view type);
bool is_image_type(std::string_view type);

/// Events of one topic, message by message. Stamps are those of the events, in ROS time.
class EventMessageDecoder {
 public:
  explicit EventMessageDecoder(std::string_view type);
  /// Replaces `events` by those of one message. Throws BadBytes.
  void decode(Bytes message, std::vector<Event>& events);
  /// Sensor size stated by the last message [px].
  [[nodiscard]] std::uint32_t width() const { return width_; }
  [[nodiscard]] std::uint32_t height() const { return height_; }

 private:
  void decode_array(ByteCursor cursor, std::vector<Event>& events) const;
  void decode_packet(ByteCursor cursor, Time header_stamp, std::vector<Event>& events);
  void decode_mono(Bytes bytes, Time stamp, std::vector<Event>& events) const;
  void decode_evt3(Bytes bytes, Time stamp, std::vector<Event>& events);

  bool packed_;
  std::uint32_t width_ = 0, height_ = 0;
  // Of evt3, whose words mean something together with those before them, even across messages:
  std::int64_t time_high_us_ = -1, time_us_ = -1;  // of the sensor, unwrapped; -1: not known yet
  std::uint16_t x_ = 0, y_ = 0;
  bool polarity_ = false;
  std::optional<Time> sensor_to_ros_;
};

/// sensor_msgs/Imu [m/s^2, rad/s]. Throws BadBytes.
ImuSample decode_imu(Bytes message);
/// geometry_msgs/PoseStamped, TransformStamped or nav_msgs/Odometry. Throws BadBytes.
StampedPose decode_pose(Bytes message, std::string_view type);
/// sensor_msgs/Image, grey (mono8, mono16, bayer_*) or in colours of 8 or 16 bits. Throws BadBytes.
void decode_image(Bytes message, Frame& frame);

}  // namespace idol
