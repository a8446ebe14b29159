#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <memory>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/report.hpp"
#include "run_recorder.hpp"

namespace idol::cli {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

struct RunArguments {
  std::filesystem::path sequence, out, rig, imu_rig;
  double rate_hz = 0;
  OptionArguments options;
  SpanArguments span;
};

void prepare_output(const std::filesystem::path& dir, Options options, const Rig& rig) {
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error) throw DataError(fmt::format("{}: cannot be created: {}", dir.string(), error.message()));
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
    fmt::print(stderr, "\r{:5.1f} %  {:6.2f} s done  {:6.0f} kev/s  real-time factor {:5.2f}  {:4} lines ", 100 * share,
               data_s, 1e-3 * static_cast<double>(events) / wall, data_s / wall, lines);
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

// Feeds the recording through the odometry. Damage ends the reading, not the run: what came before it is finished.
Outcome feed(Reader& reader, Odometry& odometry, RunRecorder& recorder, RunRecorder::Summary& summary) {
  Outcome outcome;
  ProgressBar bar;
  try {
    while (!interrupted()) {
      const auto begin = Clock::now();
      const auto packet = reader.next();
      summary.read_s += seconds_since(begin);
      if (!packet) break;
      for (const auto& sample : packet->imu) odometry.push(sample);
      odometry.push(packet->events);
      summary.events += std::ssize(packet->events);
      const double data_s = odometry.started() ? seconds_between(odometry.smoother().states().front().t,
                                                                 odometry.smoother().latest().t) : 0;
      bar.update(reader.progress(), data_s, summary.events, recorder.lines());
    }
  } catch (const DataError& e) {
    outcome = {1, e.what()};
  }
  if (interrupted()) return {kExitInterrupted, "interrupted: results so far are written"};
  try {
    odometry.finish();
  } catch (const DataError& e) {
    if (outcome.exit == 0) outcome = {1, e.what()};
  }
  return outcome;
}

void write_groundtruth(const RunArguments& arguments, const Odometry& odometry) {
  const auto truth = read_groundtruth(arguments.sequence);
  if (!truth) return;
  Trajectory span;
  const Time from = odometry.smoother().states().front().t, to = odometry.smoother().latest().t;
  for (const auto& pose : *truth)
    if (pose.t >= from && pose.t <= to) span.push_back(pose);
  write_trajectory(arguments.out / "groundtruth_camera.txt", span);
}

int run(const RunArguments& arguments) {
  const Options options = arguments.options.resolve();
  const Rig rig = load_rig(arguments.sequence, arguments.rig, arguments.imu_rig);
  ReaderOptions reading;
  reading.width = rig.camera.width;
  reading.height = rig.camera.height;
  reading.from_s = arguments.span.from_s;
  reading.to_s = arguments.span.to_s;
  const auto reader = open_reader(arguments.sequence, reading);
  prepare_output(arguments.out, options, rig);
  install_interrupt_handler();

  Odometry odometry(rig, options);
  RunRecorder recorder(arguments.out, rig, arguments.rate_hz);
  odometry.on_estimate([&](const Estimate& e) { recorder.add(e); });
  RunRecorder::Summary summary;
  summary.sequence = arguments.sequence.string();
  summary.preset = arguments.options.preset;
  Outcome outcome = feed(*reader, odometry, recorder, summary);
  if (outcome.exit == 0 && !odometry.started())
    outcome = {1, fmt::format("{}: no window could be estimated: events and IMU data do not overlap, or are too few",
                              arguments.sequence.string())};

  summary.status = outcome.exit == 0 ? "done" : outcome.message;
  summary.diagnostics = reader->diagnostics();
  summary.diagnostics.merge(odometry.diagnostics());
  recorder.write(odometry, summary);
  print_warnings(summary.diagnostics);
  if (odometry.started()) {
    write_groundtruth(arguments, odometry);
    write_report(arguments.out);
    fmt::print("{} windows, {} lines; results in {}, report: {}\n", recorder.windows(), odometry.smoother().line_count(),
               arguments.out.string(), (arguments.out / "report.html").string());
  }
  if (outcome.exit != 0) fmt::print(stderr, "idol: {}\n", outcome.message);
  return outcome.exit;
}

}  // namespace

void add_run(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<RunArguments>();
  auto* command = app.add_subcommand("run", "Estimate trajectory and 3D lines of a recording");
  command->add_option("SEQUENCE", arguments->sequence, "recording: a folder in the RPG layout")->required();
  command->add_option("--out", arguments->out, "folder for the results; created if missing")->required();
  command->add_option("--rig", arguments->rig, "camera calibration and mounting (Kalibr camchain)");
  command->add_option("--imu-rig", arguments->imu_rig, "IMU noise (Kalibr imu.yaml)");
  command->add_option("--rate", arguments->rate_hz, "sample both trajectories at this rate [Hz]")->check(CLI::PositiveNumber);
  arguments->options.declare(*command);
  arguments->span.declare(*command);
  command->callback([&action, arguments] { action = [arguments] { return run(*arguments); }; });
}

}  // namespace idol::cli
