// What the messages of a bag mean: ROS 1 serialisation of the types that an odometry reads.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/io/bytes.hpp"
#include "idol/io/frame.hpp"
#include "idol/io/sensor_clock.hpp"

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
  /// For evt3: where its clock lies. Without it, the first message tells.
  void set_clock(const SensorClock& clock) { clock_ = clock; }
  /// Adds what an evt3 message says of the clock, if it says anything. Throws BadBytes.
  static void add_to_clock(Bytes message, SensorClock& clock);
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
  void set_time_high(std::int64_t high_us, Time stamp, bool first_of_message);
  SensorClock clock_;
  std::optional<std::int64_t> high_us_;  // upper part of the sensor's time
  Time high_ = 0;                        // the same as ROS time
  std::optional<Time> time_;             // of the events that follow
  std::uint16_t x_ = 0, y_ = 0;
  bool polarity_ = false;
};

/// Which readings of a message are wanted: some IMUs send accelerations and rates apart.
enum class ImuPart { kBoth, kAccel, kGyro };
/// sensor_msgs/Imu [m/s^2, rad/s]. Throws BadBytes, and UnknownFormat where the message says that it has no
/// such readings and they are zero; if they are not, they are `doubtful`.
ImuSample decode_imu(Bytes message, ImuPart part = ImuPart::kBoth, bool* doubtful = nullptr);
/// geometry_msgs/PoseStamped, TransformStamped or nav_msgs/Odometry. Throws BadBytes. A pose of zeros or of
/// no numbers is `lost`: the capture had lost the body.
StampedPose decode_pose(Bytes message, std::string_view type, bool* lost = nullptr);
/// sensor_msgs/Image, grey (mono8, mono16, bayer_*) or in colours of 8 or 16 bits. Throws BadBytes.
void decode_image(Bytes message, Frame& frame);

}  // namespace idol
