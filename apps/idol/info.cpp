#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/recording_judgement.hpp"
#include "idol/io/recording_summary.hpp"
#include "idol/io/trajectory_io.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

struct InfoArguments {
  std::filesystem::path sequence;
  RigArguments rig;
  StreamArguments streams;
};

/// The calibration as far as there is one; an explicit file must be good.
struct Calibration {
  std::optional<Camera> camera;
  std::optional<Rig> rig;
  std::string missing;  ///< why there is no whole rig
};

Calibration find_calibration(const InfoArguments& arguments, Diagnostics& diagnostics) {
  Calibration calibration;
  Diagnostics heard;
  try {
    calibration.rig = arguments.rig.load(arguments.sequence, arguments.streams, &heard);
    calibration.camera = calibration.rig->camera;
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    if (arguments.rig.given()) throw;
    calibration.missing = e.what();
    heard = {};
    try {
      calibration.camera = find_camera(arguments.sequence, {}, &heard,
                                       camera_choice(arguments.sequence, arguments.streams.choice));
    } catch (const std::runtime_error&) {  // DataError, UsageError
      // The same trouble as above: said once.
    }
  }
  diagnostics.merge(heard);
  return calibration;
}

/// Rates over time in at most 60 blocks, the tallest being the peak.
std::string sparkline(const RateHistogram& rate) {
  constexpr const char* kBlocks[] = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
  constexpr std::size_t kWidth = 60;
  const auto& counts = rate.counts();
  const std::size_t columns = std::min(kWidth, counts.size());
  std::vector<double> heights(columns, 0);
  for (std::size_t i = 0; i < columns; ++i) {
    const std::size_t begin = i * counts.size() / columns;
    const std::size_t end = (i + 1) * counts.size() / columns;
    for (std::size_t j = begin; j < end; ++j)
      heights[i] += static_cast<double>(counts[j]) / static_cast<double>(end - begin);
  }
  const double tallest = columns > 0 ? std::max(1e-9, *std::max_element(heights.begin(), heights.end())) : 1;
  std::string text;
  for (const double height : heights)
    text += kBlocks[static_cast<std::size_t>(std::ceil(8 * height / tallest))];
  return text;
}

void print_streams(Recording& recording) {
  fmt::print("format      {}\n", recording.format());
  for (const StreamInfo& stream : recording.streams())
    fmt::print("stream      {} ({}{})\n", stream.name, stream.what,
               stream.count < 0 ? "" : fmt::format(", {}", stream.count));
}

double peak_rate(const RateHistogram& rate) {
  const auto& counts = rate.counts();
  if (counts.empty()) return 0;
  return static_cast<double>(*std::max_element(counts.begin(), counts.end())) / rate.bin_s();
}

void print_events(const RecordingSummary& s, Time origin) {
  fmt::print(
      "events      {} in {:.3f} s, from {:.3f} s on; mean {:.1f} kev/s, peak {:.1f} kev/s, {:.0f} % ON\n",
      s.events.extent().count, s.events.extent().duration_s(),
      seconds_between(origin, s.events.extent().first), 1e-3 * s.events.extent().rate_hz(),
      1e-3 * peak_rate(s.rate),
      100.0 * static_cast<double>(s.events.on_events()) / static_cast<double>(s.events.extent().count));
  fmt::print("rate        |{}|\n", sparkline(s.rate));
  fmt::print("silence     longest {:.3f} s, at {:.3f} s\n",
             static_cast<double>(s.events.extent().longest_pause) / kNsPerS,
             seconds_between(origin, s.events.extent().longest_pause_at));
}

void print_pixels(const RecordingSummary& s, const Calibration& calibration,
                  const std::vector<std::pair<int, int>>& hot) {
  const auto& camera = calibration.camera;
  fmt::print("pixels      up to ({}, {}) seen; calibration: {}\n", s.events.largest_x(), s.events.largest_y(),
             !camera              ? "none"
             : camera->width == 0 ? "resolution not known"
                                  : fmt::format("{} x {}", camera->width, camera->height));
  constexpr std::size_t kMostShown = 12;
  fmt::print("hot pixels  {}", hot.size());
  for (std::size_t i = 0; i < std::min(hot.size(), kMostShown); ++i)
    fmt::print("{}({}, {})", i == 0 ? ": " : ", ", hot[i].first, hot[i].second);
  fmt::print("{}\n", hot.size() > kMostShown ? ", ..." : "");
}

void print_imu(const RecordingSummary& s, Time origin) {
  if (s.imu.count == 0) {
    fmt::print("imu         none\n");
    return;
  }
  const auto period = s.imu_period_s();
  fmt::print("imu         {} sample{} in {:.3f} s, from {:.3f} s on{}\n", s.imu.count,
             s.imu.count == 1 ? "" : "s", s.imu.duration_s(), seconds_between(origin, s.imu.first),
             period && *period > 0 ? fmt::format("; {:.{}f} Hz", 1 / *period, *period < 1 ? 1 : 9) : "");
  if (s.imu.count < 2) return;
  fmt::print("imu gaps    {} longer than 10 periods; longest {:.1f} ms, at {:.3f} s\n", s.imu_gaps(),
             static_cast<double>(s.imu.longest_pause) / 1e6, seconds_between(origin, s.imu.longest_pause_at));
  fmt::print("imu motion  mean |a| {:.3f} m/s^2; scatter of a {:.3f} m/s^2, of the rates {:.3f} rad/s\n",
             s.accel_norm_sum / static_cast<double>(s.imu.count), s.accel.scatter(), s.gyro.scatter());
  fmt::print("overlap     {:.3f} s of events and IMU\n",
             std::max(0.0, seconds_between(std::max(s.events.extent().first, s.imu.first),
                                           std::min(s.events.extent().last, s.imu.last))));
}

void print_groundtruth(const InfoArguments& arguments, const RecordingSummary& s, Diagnostics& diagnostics) {
  std::optional<Trajectory> truth;
  try {
    truth = read_groundtruth(arguments.sequence, arguments.streams.choice);
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    diagnostics.warn("bad_groundtruth", e.what());
  }
  if (!truth) return;
  double length = 0;
  for (std::size_t i = 1; i < truth->size(); ++i) length += ((*truth)[i].T.p - (*truth)[i - 1].T.p).norm();
  fmt::print("truth       {} poses in {:.3f} s, {:.2f} m\n", truth->size(),
             seconds_between(truth->front().t, truth->back().t), length);
  if (truth->front().t > s.events.extent().last || truth->back().t < s.events.extent().first)
    diagnostics.warn("truth_elsewhere",
                     fmt::format("ground truth is of {} to {} s, of no event's time: another clock?",
                                 format_stamp(truth->front().t), format_stamp(truth->back().t)));
}

int info(InfoArguments arguments) {
  arguments.sequence = input_path(arguments.sequence);
  Diagnostics diagnostics;
  ReaderOptions reading;  // no sensor size: pixels outside are to be counted here, not refused
  reading.need_imu = false;
  reading.imu_if_present = true;
  reading.choice = arguments.streams.choice;
  const auto reader = open_reader(arguments.sequence, reading);
  const Calibration calibration = find_calibration(arguments, diagnostics);
  RecordingSummary summary(calibration.camera ? calibration.camera->width : 0,
                           calibration.camera ? calibration.camera->height : 0);
  std::string damage;
  try {
    while (const auto packet = reader->next()) summary.add(*packet);
  } catch (const DataError& e) {
    damage = e.what();
  }
  diagnostics.merge(reader->diagnostics());
  const Time origin = reader->first_stamp();
  fmt::print("recording   {}, first stamp {} s\n", arguments.sequence.string(), format_stamp(origin));
  const auto recording = open_recording(arguments.sequence, arguments.streams.choice);
  print_streams(*recording);
  const auto [width, height] = recording->resolution();
  if (width > 0 && calibration.camera && calibration.camera->width > 0 &&
      (width != calibration.camera->width || height != calibration.camera->height))
    diagnostics.warn("other_resolution",
                     fmt::format("recorded with {} x {} pixels, but the calibration is for {} x {}", width,
                                 height, calibration.camera->width, calibration.camera->height));
  if (summary.events.extent().count > 0) {
    const auto hot = summary.events.hot_pixels();
    print_events(summary, origin);
    print_pixels(summary, calibration, hot);
    print_imu(summary, origin);
    print_groundtruth(arguments, summary, diagnostics);
    if (!calibration.rig) fmt::print("warning     no whole rig: {}\n", calibration.missing);
    judge_recording(
        arguments.sequence.string(), summary,
        {calibration.camera ? &*calibration.camera : nullptr, calibration.rig ? &*calibration.rig : nullptr},
        origin, damage.empty(), diagnostics);
    if (summary.events.extent().long_pauses > 0)
      diagnostics.warn("no_events",
                       fmt::format("no event for {:.3f} s: camera still, or a part is missing",
                                   static_cast<double>(summary.events.extent().longest_pause) / kNsPerS));
  }
  for (const auto& [kind, entry] : diagnostics.entries())
    fmt::print("warning     {} ({}{})\n", entry.first_message,
               entry.count > 1 ? fmt::format("{} x ", entry.count) : "", kind);
  std::fflush(stdout);
  if (!damage.empty()) throw DataError(damage);
  return 0;
}

}  // namespace

void add_info(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<InfoArguments>();
  auto* command = app.add_subcommand("info", "Show what a recording holds, and what in it will hurt a run");
  command
      ->add_option("SEQUENCE", arguments->sequence, "recording: a folder or file of any format that is read")
      ->required();
  arguments->rig.declare(*command);
  arguments->streams.declare(*command);
  command->footer("Examples:\n  idol info recording.aedat4\n  idol info recording.aedat4 --rig davis346");
  command->callback([&action, arguments] { action = [arguments] { return info(*arguments); }; });
}

}  // namespace idol::cli
