#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_config(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("config", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("config: to come"); }; });
}

}  // namespace idol::cli
