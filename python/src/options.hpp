// Options as Python gives them: a preset's name and settings by dotted name.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "idol/odometry/presets.hpp"

namespace idol::python {

using Settings = std::map<std::string, std::string>;

/// Throws UsageError for what does not exist or is out of range.
inline Options make_options(const std::string& name, const Settings& settings) {
  Options options = preset(name);
  std::vector<OptionField> fields;
  list_fields(options, fields);
  for (const auto& [key, value] : settings) set_option(fields, key, value, "options");
  return options;
}

}  // namespace idol::python
