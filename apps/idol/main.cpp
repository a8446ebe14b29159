#include <fmt/format.h>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>
#include <string_view>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/version.hpp"

namespace {

/// No argument is empty on purpose: it is a shell variable that was not set.
void refuse_empty_arguments(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument(argv[i]);
    if (argument.empty())
      throw idol::UsageError(fmt::format("argument {} ({}) is empty: is it a shell variable that is not set?",
                                         i, i > 1 ? fmt::format("behind '{}'", argv[i - 1]) : "the first"));
    if (argument.starts_with("--") && argument.find('=') == argument.size() - 1)
      throw idol::UsageError(
          fmt::format("'{}' has no value: is it a shell variable that is not set?", argument));
  }
}

/// What was printed may still wait for a disk that is full.
int check_standard_output(int status) {
  if (std::fflush(stdout) == 0 && std::ferror(stdout) == 0) return status;
  fmt::print(stderr, "idol: standard output cannot be written; is the disk full?\n");
  return status == 0 ? 1 : status;
}

}  // namespace

// Exit status: 0 done, 1 bad data, 2 wrong usage, 3 a run that tracked nothing, 130 interrupted.
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
    refuse_empty_arguments(argc, argv);
    app.parse(argc, argv);
    const int status = action();
    return check_standard_output(status);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? check_standard_output(0) : 2;
  } catch (const idol::cli::Interrupted&) {
    fmt::print(stderr, "idol: interrupted\n");
    return idol::cli::kExitInterrupted;
  } catch (const idol::UsageError& e) {
    fmt::print(stderr, "idol: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "idol: {}\n", e.what());
    return 1;
  }
}
