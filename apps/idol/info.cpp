#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_info(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("info", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("info: to come"); }; });
}

}  // namespace idol::cli
