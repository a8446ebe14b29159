// Named sets of options.
#pragma once

#include <span>
#include <string_view>

#include "idol/odometry/odometry.hpp"

namespace idol {

/// Names that preset() knows, the default first.
std::span<const std::string_view> preset_names();

/// realtime: the options' own defaults. paper: the method as published (docs/paper.md). Throws UsageError
/// otherwise.
Options preset(std::string_view name);

}  // namespace idol
