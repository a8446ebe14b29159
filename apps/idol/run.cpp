#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <memory>
#include <optional>
#include <utility>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/jobs/recording_run.hpp"
#include "idol/view/live_view.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

struct RunArguments {
  std::filesystem::path sequence, out;
  RigArguments rig;
  double rate_hz = 0;
  bool live = false;
  bool view = false;
  int port = 0;
  OptionArguments options;
  SpanArguments span;
  StreamArguments streams;
};

// One line on a terminal, rewritten a few times a second; silent in a pipe.
class ProgressBar {
 public:
  void update(const RunListeners::Progress& p) {
    if (!terminal_ || seconds_since(last_) < 0.2) return;
    last_ = Clock::now();
    const double wall = seconds_since(begin_);
    fmt::print(stderr, "\r{:5.1f} %  {:6.2f} s done  {:6.0f} kev/s  real-time factor {:5.2f}  {:4} lines ",
               100 * p.share, p.data_s, 1e-3 * static_cast<double>(p.events) / wall, p.data_s / wall,
               p.lines);
    std::fflush(stderr);
  }
  ~ProgressBar() {
    if (terminal_) fmt::print(stderr, "\r{:80}\r", "");
  }

 private:
  bool terminal_ = isatty(STDERR_FILENO) != 0;
  Clock::time_point begin_ = Clock::now(), last_ = begin_;
};

void print_results(const RunArguments& arguments, const RecordingRun& run) {
  if (!run.odometry().started()) return;
  fmt::print("{} windows, {} lines; results in {}, report: {}\n", run.recorder().windows(),
             run.odometry().smoother().line_count(), arguments.out.string(),
             (arguments.out / "report.html").string());
  if (const auto latency = run.recorder().latency())
    fmt::print(
        "latency from a window's last event to its pose: median {:.1f} ms, 99 % {:.1f} ms, worst {:.1f} ms\n",
        1e3 * latency->median, 1e3 * latency->p99, 1e3 * latency->worst);
  if (!run.figures().empty()) fmt::print("{}\n", run.figures());
}

// The last part of a path, also of one that ends in a slash.
std::string shown_name(const std::filesystem::path& path) {
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

int run(const RunArguments& arguments) {
  install_interrupt_handler();
  RunRequest request;
  request.sequence = input_path(arguments.sequence);
  request.rig_path = arguments.rig.rig;
  request.imu_rig_path = arguments.rig.imu_rig;
  request.out = arguments.out;
  request.preset = arguments.options.preset;
  request.options = arguments.options.resolve();
  InputPaths options;
  options.add(arguments.options.config);
  options.refuse_output(arguments.out);
  request.from_s = arguments.span.from_s;
  request.to_s = arguments.span.to_s;
  request.choice = arguments.streams.choice;
  request.rate_hz = arguments.rate_hz;
  request.live = arguments.live;
  std::optional<ProgressBar> bar;
  RunListeners listeners;
  listeners.interrupted = interrupted;
  listeners.progress = [&](const RunListeners::Progress& progress) { bar->update(progress); };
  std::optional<LiveView> view;
  listeners.sight = [&](const Estimate& estimate, const Sight& sight) {
    if (view) view->add(estimate, sight);
  };
  RecordingRun run(std::move(request), std::move(listeners));
  if (arguments.view) {
    view.emplace(shown_name(arguments.sequence), run.rig(), arguments.port);
    fmt::print(stderr, "idol: watch it at {}\n", view->url());
  }
  print_warnings(run.checks());
  bar.emplace();
  const RecordingRun::Outcome outcome = run.go();
  bar.reset();
  print_results(arguments, run);
  if (view)
    view->finish(outcome.message.empty()
                     ? fmt::format("Its report is {}.", (arguments.out / "report.html").string())
                     : outcome.message);
  // One line on a failure: its reason. The rest is in stats.json.
  if (outcome.end != RecordingRun::End::kBadData) print_warnings(run.diagnostics(), run.checks());
  if (outcome.end == RecordingRun::End::kDone) return 0;
  if (outcome.end == RecordingRun::End::kNothingTracked) return kExitNothingTracked;
  fmt::print(stderr, "idol: {}\n", outcome.message);
  return outcome.end == RecordingRun::End::kInterrupted ? kExitInterrupted : 1;
}

}  // namespace

void add_run(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<RunArguments>();
  auto* command = app.add_subcommand("run", "Estimate trajectory and 3D lines of a recording");
  command
      ->add_option("SEQUENCE", arguments->sequence, "recording: a folder or file of any format that is read")
      ->required();
  command->add_option("--out", arguments->out, "folder for the results; created if missing")->required();
  arguments->rig.declare(*command);
  command->add_option("--rate", arguments->rate_hz, "sample both trajectories at this rate [Hz]")
      ->check(CLI::PositiveNumber);
  command->add_flag("--live", arguments->live,
                    "play the recording in its own time, drop nothing, and measure the latency of each pose");
  auto* view = command->add_flag("--view", arguments->view,
                                 "let a browser on this computer watch the run; prints the address");
  command->add_option("--port", arguments->port, "port for --view; 0: any that is free")
      ->check(CLI::Range(0, 65535))
      ->needs(view)
      ->capture_default_str();
  arguments->options.declare(*command);
  arguments->span.declare(*command);
  arguments->streams.declare(*command);
  command->footer(
      "Examples:\n"
      "  idol run shapes_6dof.bag --out out                       of the RPG dataset\n"
      "  idol run recording.bag --rig rig.yaml --from 5 --to 20 --out out\n"
      "  idol run recording.aedat4 --rig rig.yaml --preset paper --set window.overlap=0 --out out");
  command->callback([&action, arguments] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace idol::cli
