#include <fmt/format.h>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>

#include "commands.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/version.hpp"

// Exit status: 0 done, 1 bad data, 2 wrong usage, 130 interrupted.
int main(int argc, char** argv) {
  CLI::App app{"idol: event-camera and IMU odometry with lines", "idol"};
  app.set_version_flag("--version", std::string("idol ") + idol::kVersion);
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  idol info recording.bag --rig rig.yaml           what is in it, and what will hurt a run\n"
      "  idol run  recording.bag --rig rig.yaml --out out\n"
      "  idol convert recording.aedat4 recording.h5");
  app.failure_message([](const CLI::App*, const CLI::Error& e) {
    std::string reason = e.what();
    std::replace(reason.begin(), reason.end(), '\n', ' ');
    return fmt::format("idol: {}; 'idol --help' and 'idol COMMAND --help' tell the usage\n", reason);
  });
  idol::cli::Action action;
  idol::cli::add_run(app, action);
  idol::cli::add_segment(app, action);
  idol::cli::add_evaluate(app, action);
  idol::cli::add_simulate(app, action);
  idol::cli::add_convert(app, action);
  idol::cli::add_info(app, action);
  idol::cli::add_preintegrate(app, action);
  idol::cli::add_report(app, action);
  idol::cli::add_compare(app, action);
  idol::cli::add_view(app, action);
  idol::cli::add_config(app, action);
  idol::cli::add_completion(app, action);
  try {
    app.parse(argc, argv);
    return action();
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  } catch (const idol::UsageError& e) {
    fmt::print(stderr, "idol: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "idol: {}\n", e.what());
    return 1;
  }
}
