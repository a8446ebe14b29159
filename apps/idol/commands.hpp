// The table of subcommands. Each add_* declares its options on `app` and sets `action` when chosen.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace idol::cli {

using Action = std::function<int()>;

void add_run(CLI::App& app, Action& action);
void add_segment(CLI::App& app, Action& action);
void add_evaluate(CLI::App& app, Action& action);
void add_simulate(CLI::App& app, Action& action);
void add_convert(CLI::App& app, Action& action);
void add_info(CLI::App& app, Action& action);
void add_preintegrate(CLI::App& app, Action& action);
void add_report(CLI::App& app, Action& action);
void add_compare(CLI::App& app, Action& action);
void add_view(CLI::App& app, Action& action);
void add_completion(CLI::App& app, Action& action);
void add_config(CLI::App& app, Action& action);

}  // namespace idol::cli
