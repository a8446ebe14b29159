#include "commands.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::cli {

void add_report(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("report", "to come");
  command->callback([&action] { action = []() -> int { throw DataError("report: to come"); }; });
}

}  // namespace idol::cli
