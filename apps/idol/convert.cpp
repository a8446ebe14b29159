#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/recording_writer.hpp"
#include "idol/io/text_writer.hpp"

namespace idol::cli {
namespace {

namespace fs = std::filesystem;

struct ConvertArguments {
  fs::path in, out;
  RigArguments rig;
  std::string format;
  bool compress = false;
  SpanArguments span;
  StreamArguments streams;
};

const std::map<std::string, RecordingFormat> kFormats = {{"text", RecordingFormat::kText},
                                                         {"bag", RecordingFormat::kBag},
                                                         {"hdf5", RecordingFormat::kHdf5},
                                                         {"aedat4", RecordingFormat::kAedat4}};

struct Counts {
  std::int64_t events = 0, imu = 0;
  std::optional<Time> first, last;

  void add(const Packet& packet) {
    events += std::ssize(packet.events);
    imu += std::ssize(packet.imu);
    const auto extend = [&](Time from, Time to) {
      first = first ? std::min(*first, from) : from;
      last = last ? std::max(*last, to) : to;
    };
    if (!packet.events.empty()) extend(packet.events.front().t, packet.events.back().t);
    if (!packet.imu.empty()) extend(packet.imu.front().t, packet.imu.back().t);
  }
};

/// A file is not written over itself: it would be gone before it is read.
void check_not_same(const ConvertArguments& arguments) {
  std::error_code ignored;
  if (fs::equivalent(arguments.in, arguments.out, ignored))
    throw UsageError(fmt::format("{}: is to be read and written; give another OUT", arguments.out.string()));
}

/// The truth of the time that was converted; number of poses.
std::int64_t convert_groundtruth(const ConvertArguments& arguments, const Counts& counts,
                                 RecordingWriter& writer, Diagnostics& diagnostics) {
  if (!counts.first) return 0;
  Trajectory truth;
  try {
    const auto recording = open_recording(arguments.in, arguments.streams.choice);
    for (const auto& pose : recording->groundtruth().value_or(Trajectory{}))
      if (pose.t >= *counts.first && pose.t <= *counts.last) truth.push_back(pose);
    if (recording->truth_of_imu() && !truth.empty()) {
      const Rig rig = arguments.rig.known(arguments.in);
      for (StampedPose& pose : truth) pose.T = pose.T * rig.T_i_c;
    }
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    diagnostics.warn("bad_groundtruth", fmt::format("{}; written without ground truth", e.what()));
    return 0;
  }
  if (truth.empty()) return 0;
  if (writer.add_groundtruth(truth)) return std::ssize(truth);
  diagnostics.warn("no_place_for_groundtruth",
                   fmt::format("{}: the format has no place for ground truth", arguments.out.string()));
  return 0;
}

int convert(const ConvertArguments& arguments) {
  install_interrupt_handler();
  Diagnostics diagnostics;
  check_not_same(arguments);
  ReaderOptions reading;
  reading.from_s = arguments.span.from_s;
  reading.to_s = arguments.span.to_s;
  reading.need_imu = false;
  reading.imu_if_present = true;
  reading.need_events = false;
  reading.choice = arguments.streams.choice;
  const RecordingFormat format =
      arguments.format.empty() ? format_of_name(arguments.out) : kFormats.at(arguments.format);
  std::optional<Rig> rig;
  try {
    rig = arguments.rig.known(arguments.in);
  } catch (const DataError&) {
    if (arguments.rig.given()) throw;
  }
  const auto reader = open_reader(arguments.in, reading);
  const auto stated = open_recording(arguments.in, arguments.streams.choice)->resolution();
  WriterOptions writing{stated.width, stated.height, arguments.compress};
  if (writing.width == 0 && rig) writing = {rig->camera.width, rig->camera.height, arguments.compress};
  const auto writer = create_recording(arguments.out, format, writing);
  Counts counts;
  std::string damage;
  try {
    while (!interrupted()) {
      const auto packet = reader->next();
      if (!packet) break;
      counts.add(*packet);
      writer->add(*packet);
    }
  } catch (const DataError& e) {
    damage = e.what();
  }
  const std::int64_t poses = convert_groundtruth(arguments, counts, *writer, diagnostics);
  writer->close();
  if (format == RecordingFormat::kText && rig)
    write_text_file(arguments.out / "camchain-imucam.yaml", rig_to_yaml(*rig));
  fmt::print("{} events, {} IMU samples, {} poses written to {}\n", counts.events, counts.imu, poses,
             arguments.out.string());
  std::fflush(stdout);
  diagnostics.merge(reader->diagnostics());
  if (!damage.empty()) throw DataError(damage);
  print_warnings(diagnostics);
  return interrupted() ? kExitInterrupted : 0;
}

}  // namespace

void add_convert(CLI::App& app, Action& action) {
  auto a = std::make_shared<ConvertArguments>();
  auto* command = app.add_subcommand("convert", "Write a recording in another format");
  command->add_option("IN", a->in, "recording: a folder or file of any format that is read")->required();
  command->add_option("OUT", a->out, "by its ending .bag, .h5, .aedat4; else a folder of text files")
      ->required();
  command->add_option("--format", a->format, "of OUT, whatever it is called")
      ->check(CLI::IsMember({"text", "bag", "hdf5", "aedat4"}));
  command->add_flag("--compress", a->compress, "smaller, and slower to read");
  a->rig.declare(*command);
  a->span.declare(*command);
  a->streams.declare(*command);
  command->footer(
      "Examples:\n"
      "  idol convert recording.aedat4 recording.bag\n"
      "  idol convert recording.bag folder --from 5 --to 20 --compress\n"
      "  idol convert events.h5 all.h5 --imu imu.bag --imu-topic /imu/data");
  command->callback([&action, a] { action = [a] { return convert(*a); }; });
}

}  // namespace idol::cli
