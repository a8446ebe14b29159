// Messages of a bag: the first byte chooses the type; two of them, since some encodings go on from one to the
// next.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "idol/io/bag_messages.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const idol::Bytes message(data + 1, size - 1);
  constexpr const char* kTypes[] = {
      "dvs_msgs/EventArray", "prophesee_event_msgs/EventArray", "event_camera_msgs/EventPacket",
      "sensor_msgs/Imu",     "geometry_msgs/PoseStamped",       "nav_msgs/Odometry",
      "sensor_msgs/Image"};
  const char* type = kTypes[data[0] % std::size(kTypes)];
  try {
    if (idol::is_event_type(type)) {
      idol::EventMessageDecoder decoder(type);
      std::vector<idol::Event> events;
      for (int i = 0; i < 2; ++i) decoder.decode(message, events);
    } else if (idol::is_imu_type(type)) {
      static_cast<void>(idol::decode_imu(message));
    } else if (idol::is_image_type(type)) {
      idol::Frame frame;
      idol::decode_image(message, frame);
    } else {
      static_cast<void>(idol::decode_pose(message, type));
    }
  } catch (const idol::BadBytes&) {
  }
  return 0;
}
