#include <fmt/format.h>

#include "arguments.hpp"
#include "commands.hpp"

namespace idol::cli {

void add_config(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<OptionArguments>();
  auto* command = app.add_subcommand("config", "Print every option with its value and meaning, as a file for --config");
  arguments->declare(*command);
  command->footer("Examples:\n  idol config --preset paper > paper.yaml");
  command->callback([&action, arguments] {
    action = [arguments] {
      Options options = arguments->resolve();
      std::vector<OptionField> fields;
      list_fields(options, fields);
      fmt::print("{}", dump_options(fields));
      return 0;
    };
  });
}

}  // namespace idol::cli
