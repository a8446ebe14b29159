#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <thread>
#include <vector>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/view/run_server.hpp"

namespace idol::cli {

void add_view(CLI::App& app, Action& action) {
  struct Arguments {
    std::vector<std::filesystem::path> dirs;
    int port = 0;
  };
  auto arguments = std::make_shared<Arguments>();
  auto* command = app.add_subcommand("view", "Show one or several runs in a browser on this computer");
  command->add_option("DIR", arguments->dirs, "folders that 'idol run --out' wrote to")->required();
  command->add_option("--port", arguments->port, "port of 127.0.0.1; 0: any that is free")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command->footer("Examples:\n  idol view out\n  idol view out/realtime out/paper --port 8080");
  command->callback([=, &action] {
    action = [=] {
      install_interrupt_handler();
      const RunServer server(arguments->dirs, arguments->port);
      fmt::print("{}\n", server.url());
      std::fflush(stdout);
      fmt::print(stderr, "idol: open this address in a browser; Ctrl-C ends it\n");
      while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
      return 0;
    };
  });
}

}  // namespace idol::cli
