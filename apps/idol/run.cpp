#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_run(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("run", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("run: to come"); }; });
}

}  // namespace idol::cli
