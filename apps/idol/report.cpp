#include "idol/report/report.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "commands.hpp"

namespace idol::cli {

void add_report(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("report", "Make report.html of a run's folder anew");
  auto dir = std::make_shared<std::string>();
  command->add_option("DIR", *dir, "Folder that 'idol run --out' wrote to")->required();
  command->footer("Examples:\n  idol report out");
  command->callback([=, &action] {
    action = [=] {
      const std::filesystem::path folder(*dir);
      write_report(folder);
      fmt::print("{}\n", (folder / "report.html").string());
      return 0;
    };
  });
}

}  // namespace idol::cli
