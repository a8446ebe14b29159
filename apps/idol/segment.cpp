#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_segment(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("segment", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("segment: to come"); }; });
}

}  // namespace idol::cli
