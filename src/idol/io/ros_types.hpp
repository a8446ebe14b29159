// The ROS 1 message types that are read and written, as ROS knows them: what a bag calls the same must be the
// same.
#pragma once

#include <string>
#include <string_view>

namespace idol {

struct RosType {
  std::string_view name;        ///< package/Message
  std::string_view md5sum;      ///< empty: not compared
  std::string_view definition;  ///< as a bag's connection holds it
};

/// Nullptr for any other name.
const RosType* find_ros_type(std::string_view name);

/// Why a bag's messages of this name are not those that are read; empty if they are. The fields decide,
/// whatever comments and packages are written with them; the md5 sum does where the bag holds no definition.
std::string other_definition(std::string_view name, std::string_view md5sum, std::string_view definition);

}  // namespace idol
