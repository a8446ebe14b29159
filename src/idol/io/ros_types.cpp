#include "idol/io/ros_types.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

#define IDOL_ROS_RULE "================================================================================\n"
#define IDOL_ROS_HEADER IDOL_ROS_RULE "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
#define IDOL_ROS_QUATERNION \
  IDOL_ROS_RULE             \
  "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
#define IDOL_ROS_VECTOR IDOL_ROS_RULE "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
#define IDOL_ROS_POSE                                                                             \
  IDOL_ROS_RULE "MSG: geometry_msgs/Pose\nPoint position\nQuaternion orientation\n" IDOL_ROS_RULE \
                "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n" IDOL_ROS_QUATERNION

constexpr RosType kTypes[] = {
    {"dvs_msgs/EventArray", "5e8beee5a6c107e504c2e78903c224b8",
     "Header header\nuint32 height\nuint32 width\nEvent[] events\n" IDOL_ROS_HEADER IDOL_ROS_RULE
     "MSG: dvs_msgs/Event\nuint16 x\nuint16 y\ntime ts\nbool polarity\n"},
    {"prophesee_event_msgs/EventArray", "5e8beee5a6c107e504c2e78903c224b8",
     "Header header\nuint32 height\nuint32 width\nEvent[] events\n" IDOL_ROS_HEADER IDOL_ROS_RULE
     "MSG: prophesee_event_msgs/Event\nuint16 x\nuint16 y\ntime ts\nbool polarity\n"},
    // Its md5 sum is not known for sure.
    {"event_camera_msgs/EventPacket", "",
     "Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\nbool "
     "is_bigendian\n"
     "uint8[] events\n" IDOL_ROS_HEADER},
    {"sensor_msgs/Imu", "6a62c6daae103f4ff57a132d6f95cec2",
     "Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
     "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
     "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n" IDOL_ROS_HEADER
         IDOL_ROS_QUATERNION IDOL_ROS_VECTOR},
    {"geometry_msgs/PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5",
     "Header header\nPose pose\n" IDOL_ROS_HEADER IDOL_ROS_POSE},
    {"geometry_msgs/TransformStamped", "b5764a33bfeb3588febc2682852579b0",
     "Header header\nstring child_frame_id\nTransform transform\n" IDOL_ROS_HEADER IDOL_ROS_RULE
     "MSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation\n" IDOL_ROS_VECTOR
         IDOL_ROS_QUATERNION},
    {"nav_msgs/Odometry", "cd5e73d190d741a2f92e81eda573aca7",
     "Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
     "geometry_msgs/TwistWithCovariance twist\n" IDOL_ROS_HEADER IDOL_ROS_RULE
     "MSG: geometry_msgs/PoseWithCovariance\nPose pose\nfloat64[36] covariance\n" IDOL_ROS_POSE},
    {"sensor_msgs/Image", "060021388200f6f0f447d0fcd9c64743",
     "Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] "
     "data\n" IDOL_ROS_HEADER},
};

#undef IDOL_ROS_POSE
#undef IDOL_ROS_VECTOR
#undef IDOL_ROS_QUATERNION
#undef IDOL_ROS_HEADER
#undef IDOL_ROS_RULE

std::string_view without_package(std::string_view type) { return type.substr(type.find('/') + 1); }

/// The fields of a definition by message ("" is the message itself): "type name;" each, without comments,
/// packages and constants.
std::map<std::string, std::string> fields_of(std::string_view definition) {
  std::map<std::string, std::string> fields;
  std::string message;
  while (!definition.empty()) {
    const auto end = std::min(definition.find('\n'), definition.size());
    std::string_view line = definition.substr(0, end);
    definition.remove_prefix(std::min(end + 1, definition.size()));
    line = line.substr(0, line.find('#'));
    const auto word = [&] {
      const auto begin = std::min(line.find_first_not_of(" \t\r"), line.size());
      const auto stop = std::min(line.find_first_of(" \t\r", begin), line.size());
      const std::string_view found = line.substr(begin, stop - begin);
      line.remove_prefix(stop);
      return found;
    };
    const std::string_view type = word(), name = word();
    if (type == "MSG:") {
      message = without_package(name);
    } else if (!type.empty() && !type.starts_with("==") && name.find('=') == std::string_view::npos &&
               !word().starts_with('=')) {
      fields[message] += fmt::format("{} {};", without_package(type), name);
    }
  }
  return fields;
}

}  // namespace

const RosType* find_ros_type(std::string_view name) {
  const auto* found =
      std::find_if(std::begin(kTypes), std::end(kTypes), [&](const RosType& t) { return t.name == name; });
  return found == std::end(kTypes) ? nullptr : found;
}

std::string other_definition(std::string_view name, std::string_view md5sum, std::string_view definition) {
  const RosType* known = find_ros_type(name);
  if (known == nullptr || (!known->md5sum.empty() && md5sum == known->md5sum)) return {};
  bool same = known->md5sum.empty() || md5sum.empty() || md5sum == "*";
  if (const auto fields = fields_of(definition); !fields.empty()) {
    same = true;
    for (const auto& [message, expected] : fields_of(known->definition)) {
      const auto stated = fields.find(message);
      same = same && (stated == fields.end() ? !message.empty() : stated->second == expected);
    }
  }
  if (same) return {};
  return fmt::format("{} of another definition (md5 {}, {} is read); convert the bag's messages to that one",
                     name, printable(md5sum), known->md5sum.empty() ? "another" : known->md5sum);
}

}  // namespace idol
