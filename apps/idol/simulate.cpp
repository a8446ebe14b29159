#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_simulate(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("simulate", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("simulate: to come"); }; });
}

}  // namespace idol::cli
