#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_evaluate(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("evaluate", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("evaluate: to come"); }; });
}

}  // namespace idol::cli
