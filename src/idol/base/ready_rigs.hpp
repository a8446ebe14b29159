// The rigs that come with the program, by name: configs/rig_NAME.yaml, put into it by CMake.
#pragma once

#include <span>
#include <string_view>

namespace idol {

struct ReadyRig {
  std::string_view name;  ///< for instance davis240c
  std::string_view yaml;
};

/// In alphabetical order.
std::span<const ReadyRig> ready_rigs();

}  // namespace idol
