#include "idol/io/choose_stream.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "idol/base/diagnostics.hpp"

namespace idol {

std::optional<std::size_t> choose_stream(const std::string& file, const char* kind, const char* option,
                                         const std::vector<std::string>& candidates,
                                         const std::string& name) {
  if (!name.empty()) {
    const auto found = std::find(candidates.begin(), candidates.end(), name);
    if (found != candidates.end()) return static_cast<std::size_t>(found - candidates.begin());
    throw UsageError(
        fmt::format("{}: {} '{}' is none of the {}: {}", file, option, printable(name), kind,
                    candidates.empty() ? "there are none" : fmt::format("{}", fmt::join(candidates, ", "))));
  }
  if (candidates.empty()) return std::nullopt;
  if (candidates.size() == 1) return 0;
  throw UsageError(fmt::format("{}: there are several {}: {}; choose one with {}", file, kind,
                               fmt::join(candidates, ", "), option));
}

}  // namespace idol
