// One stream out of several, by name or because there is no other.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace idol {

/// Index of the candidate called `name`, or of the only one when `name` is empty; nothing if there is none at
/// all. Throws UsageError, naming the candidates and the `option` to choose with, when `name` is none of
/// them, or empty and there are several. `kind` is what they are, in the plural: "topics with events".
std::optional<std::size_t> choose_stream(const std::string& file, const char* kind, const char* option,
                                         const std::vector<std::string>& candidates, const std::string& name);

}  // namespace idol
