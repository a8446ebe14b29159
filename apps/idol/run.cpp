#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <span>
#include <utility>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/io/event_monitor.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/report/report.hpp"
#include "run_recorder.hpp"
#include "run_truth.hpp"

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
  OptionArguments options;
  SpanArguments span;
  StreamArguments streams;
};

// Creates the folder, or clears it of an earlier run, whose results must not pass for those of this one.
void prepare_output(const std::filesystem::path& dir, Options options, const Rig& rig) {
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error)
    throw DataError(
        fmt::format("{}: cannot be created: {}; give another --out", dir.string(), error.message()));
  for (const char* name :
       {"trajectory_camera.txt", "trajectory_imu.txt", "trajectory_camera_causal.txt",
        "trajectory_imu_causal.txt", "states.csv", "lines.csv", "lines.ply", "windows.csv", "stats.json",
        "rig_refined.yaml", "groundtruth_camera.txt", "evaluation.json", "report.html"})
    std::filesystem::remove(dir / name, error);
  std::vector<OptionField> fields;
  list_fields(options, fields);
  write_text_file(dir / "config.yaml", dump_options(fields));
  write_text_file(dir / "rig.yaml", rig_to_yaml(rig));
}

// One line on a terminal, rewritten a few times a second; silent in a pipe.
class ProgressBar {
 public:
  void update(double share, double data_s, std::int64_t events, int lines) {
    if (!terminal_ || seconds_since(last_) < 0.2) return;
    last_ = Clock::now();
    const double wall = seconds_since(begin_);
    fmt::print(stderr, "\r{:5.1f} %  {:6.2f} s done  {:6.0f} kev/s  real-time factor {:5.2f}  {:4} lines ",
               100 * share, data_s, 1e-3 * static_cast<double>(events) / wall, data_s / wall, lines);
    std::fflush(stderr);
  }
  ~ProgressBar() {
    if (terminal_) fmt::print(stderr, "\r{:80}\r", "");
  }

 private:
  bool terminal_ = isatty(STDERR_FILENO) != 0;
  Clock::time_point begin_ = Clock::now(), last_ = begin_;
};

struct Outcome {
  int exit = 0;
  std::string message;  // of a failure
};

// What one run works on.
struct Run {
  const RunArguments& arguments;
  const Rig& rig;
  Reader& reader;
  Odometry odometry;
  RunRecorder recorder;
  EventMonitor monitor;
  RunRecorder::Summary summary;
};

// Of the events from `from` on: at most a thousand, of one millisecond.
std::span<const Event> next_piece(const std::vector<Event>& events, std::size_t from) {
  constexpr std::size_t kMost = 1000;
  constexpr Time kLongest = kNsPerS / 1000;
  std::size_t to = from + 1;
  while (to < events.size() && to - from < kMost && events[to].t - events[from].t < kLongest) ++to;
  return {events.data() + from, to - from};
}

// In small pieces, which change no result, so that Ctrl-C is heard soon; each in its own time if live.
void push(Run& run, const Packet& packet, ProgressBar& bar) {
  const Time offset = from_seconds(run.rig.time_offset_s);
  auto sample = packet.imu.begin();
  for (std::size_t i = 0; i < packet.events.size() && !interrupted();) {
    const auto piece = next_piece(packet.events, i);
    i += piece.size();
    if (run.arguments.live) run.recorder.wait_until_due(piece.back().t);
    for (; sample != packet.imu.end() && sample->t <= piece.back().t + offset; ++sample)
      run.odometry.push(*sample);
    run.odometry.push(piece);
    run.monitor.add(piece);
    run.summary.events += std::ssize(piece);
    bar.update(run.reader.progress(), run.recorder.data_s(), run.summary.events, run.recorder.lines());
  }
  for (; sample != packet.imu.end(); ++sample) run.odometry.push(*sample);
  if (run.reader.imu_over()) run.odometry.end_imu();
}

// Feeds the recording through the odometry. Damage ends the reading, not the run: what came before it is
// finished.
Outcome feed(Run& run) {
  constexpr std::int64_t kEnoughToJudge = 500000;  // events after which a wrong sensor would show
  const auto check_sensor = [&] {
    check_sensor_fit(run.summary.sequence, run.monitor, run.rig.camera, run.summary.diagnostics);
  };
  Outcome outcome;
  ProgressBar bar;
  bool judged = false;
  try {
    while (!interrupted()) {
      const auto begin = Clock::now();
      const auto packet = run.reader.next();
      run.summary.read_s += seconds_since(begin);
      if (!packet) break;
      push(run, *packet, bar);
      if (!judged && run.summary.events >= kEnoughToJudge) {
        judged = true;
        check_sensor();
      }
    }
    if (!judged) check_sensor();
  } catch (const DataError& e) {
    outcome = {1, e.what()};
  }
  try {
    interrupted() ? run.odometry.wait() : run.odometry.finish();
  } catch (const DataError& e) {
    if (outcome.exit == 0) outcome = {1, e.what()};
  }
  if (interrupted()) return {kExitInterrupted, "interrupted: results so far are written"};
  return outcome;
}

Outcome explain_no_estimate(const Run& run) {
  const Diagnostics heard = run.odometry.diagnostics();
  const std::string why = heard.entries().empty() ? "events and IMU data are too few, or do not overlap"
                                                  : heard.entries().begin()->second.first_message;
  return {1, fmt::format("{}: no window could be estimated: {}", run.summary.sequence, why)};
}

// Of no consequence for the estimate: damage is a warning.
void add_backdrops(Run& run) {
  try {
    if (const auto frames = open_recording(run.arguments.sequence, run.arguments.streams.choice)->frames())
      run.recorder.add_backdrops(*frames);
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    run.summary.diagnostics.warn("bad_frames", e.what());
  }
}

// Results first, then what is said about them: even a damaged recording leaves what came before.
Outcome estimate_and_write(Run& run) {
  const auto& out = run.arguments.out;
  Outcome outcome = feed(run);
  if (outcome.exit == 0 && !run.odometry.started()) outcome = explain_no_estimate(run);
  if (run.odometry.started()) add_backdrops(run);
  run.recorder.write_results(run.odometry);
  auto& summary = run.summary;
  summary.status = outcome.exit == 0 ? "done" : outcome.message;
  run.monitor.report(summary.sequence, summary.diagnostics);
  summary.diagnostics.merge(run.reader.diagnostics());
  summary.diagnostics.merge(run.odometry.diagnostics());
  std::string figures;
  if (run.odometry.started())
    figures = judge_against_truth(run.arguments.sequence, run.arguments.streams.choice, run.rig.T_i_c, out,
                                  summary.diagnostics);
  run.recorder.write_stats(run.odometry, summary);
  if (run.odometry.started()) {
    write_report(out);
    fmt::print("{} windows, {} lines; results in {}, report: {}\n", run.recorder.windows(),
               run.odometry.smoother().line_count(), out.string(), (out / "report.html").string());
    if (const auto latency = run.recorder.latency())
      fmt::print(
          "latency from a window's last event to its pose: median {:.1f} ms, 99 % {:.1f} ms, worst {:.1f} "
          "ms\n",
          1e3 * latency->median, 1e3 * latency->p99, 1e3 * latency->worst);
    if (!figures.empty()) fmt::print("{}\n", figures);
  }
  return outcome;
}

int run(const RunArguments& arguments) {
  const Options options = arguments.options.resolve();
  install_interrupt_handler();
  RunRecorder::Summary summary;
  summary.sequence = arguments.sequence.string();
  summary.preset = arguments.options.preset;
  check_exists(arguments.sequence);
  const Rig rig = arguments.rig.load(arguments.sequence, arguments.streams, &summary.diagnostics);
  ReaderOptions reading;
  reading.width = rig.camera.width;
  reading.height = rig.camera.height;
  reading.from_s = arguments.span.from_s;
  reading.to_s = arguments.span.to_s;
  reading.imu_offset_s = rig.time_offset_s;
  reading.imu_near_events = true;
  reading.choice = arguments.streams.choice;
  const auto reader = open_reader(arguments.sequence, reading);
  prepare_output(arguments.out, options, rig);

  Run run{arguments,
          rig,
          *reader,
          Odometry(rig, options),
          RunRecorder(arguments.out, rig, arguments.rate_hz),
          EventMonitor(rig.camera.width, rig.camera.height),
          std::move(summary)};
  run.odometry.on_estimate([&](const Estimate& e) { run.recorder.add(e); });
  const Outcome outcome = estimate_and_write(run);
  // One line on a failure: its reason. The rest is in stats.json.
  if (outcome.exit != 1) print_warnings(run.summary.diagnostics);
  if (outcome.exit != 0) fmt::print(stderr, "idol: {}\n", outcome.message);
  return outcome.exit;
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
