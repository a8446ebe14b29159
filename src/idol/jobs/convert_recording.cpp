#include "idol/jobs/convert_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <stdexcept>

#include "idol/base/rig.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/text_writer.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

/// The time that all packets together cover.
struct Extent {
  std::optional<Time> first, last;

  void add(const Packet& packet) {
    if (!packet.events.empty()) extend(packet.events.front().t, packet.events.back().t);
    if (!packet.imu.empty()) extend(packet.imu.front().t, packet.imu.back().t);
  }
  void extend(Time from, Time to) {
    first = first ? std::min(*first, from) : from;
    last = last ? std::max(*last, to) : to;
  }
};

void check_output(const ConvertRequest& request) {
  check_exists(request.in);
  InputPaths inputs;
  inputs.add_recording(request.in, request.choice, request.rig_path, request.imu_rig_path);
  inputs.refuse_output(request.out);
}

/// Whether there is a result of before, which only a conversion that comes to its end may replace.
bool is_there(const fs::path& out) {
  std::error_code ignored;
  return fs::is_regular_file(out, ignored) || (fs::is_directory(out, ignored) && !fs::is_empty(out, ignored));
}

ReaderOptions reader_options(const ConvertRequest& request) {
  ReaderOptions reading;
  reading.from_s = request.from_s;
  reading.to_s = request.to_s;
  reading.need_imu = false;
  reading.imu_if_present = true;
  reading.need_events = false;
  reading.choice = request.choice;
  return reading;
}

/// The rig as far as there is one; an explicit file must be good.
std::optional<Rig> find_rig(const ConvertRequest& request) {
  try {
    return load_rig(request.in, request.rig_path, request.imu_rig_path, nullptr, {},
                    camera_choice(request.in, request.choice));
  } catch (const std::runtime_error&) {  // DataError, UsageError
    if (!request.rig_path.empty() || !request.imu_rig_path.empty()) throw;
  }
  return std::nullopt;
}

/// The truth of the time that was converted; number of poses.
std::int64_t convert_groundtruth(const ConvertRequest& request, const Extent& extent, RecordingWriter& writer,
                                 Diagnostics& diagnostics) {
  if (!extent.first) return 0;
  Trajectory truth;
  try {
    const auto recording = open_recording(request.in, request.choice);
    for (const auto& pose : recording->groundtruth().value_or(Trajectory{}))
      if (pose.t >= *extent.first && pose.t <= *extent.last) truth.push_back(pose);
    if (recording->truth_of_imu() && !truth.empty()) {
      const Rig rig = load_rig(request.in, request.rig_path, request.imu_rig_path, nullptr, {},
                               camera_choice(request.in, request.choice));
      for (StampedPose& pose : truth) pose.T = pose.T * rig.T_i_c;
    }
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    diagnostics.warn("bad_groundtruth", fmt::format("{}; written without ground truth", e.what()));
    return 0;
  }
  if (truth.empty()) return 0;
  if (writer.add_groundtruth(truth)) return std::ssize(truth);
  diagnostics.warn("no_place_for_groundtruth",
                   fmt::format("{}: the format has no place for ground truth", request.out.string()));
  return 0;
}

}  // namespace

std::optional<RecordingFormat> parse_recording_format(const std::string& name) {
  static const std::map<std::string, RecordingFormat> formats = {{"text", RecordingFormat::kText},
                                                                 {"bag", RecordingFormat::kBag},
                                                                 {"hdf5", RecordingFormat::kHdf5},
                                                                 {"aedat4", RecordingFormat::kAedat4}};
  const auto it = formats.find(name);
  return it == formats.end() ? std::nullopt : std::optional(it->second);
}

Conversion convert_recording(const ConvertRequest& request, const std::function<bool()>& interrupted) {
  check_output(request);
  const std::optional<Rig> rig = find_rig(request);
  const auto reader = open_reader(request.in, reader_options(request));
  const auto stated = open_recording(request.in, request.choice)->resolution();
  WriterOptions writing{stated.width, stated.height, request.compress};
  if (writing.width == 0 && rig) writing = {rig->camera.width, rig->camera.height, request.compress};
  const RecordingFormat format = request.format.value_or(format_of_name(request.out));
  const bool replaces = is_there(request.out);
  const auto writer = create_recording(request.out, format, writing);
  Conversion done;
  Extent extent;
  bool whole = false;
  try {
    while (!(interrupted && interrupted())) {
      const auto packet = reader->next();
      whole = !packet;
      if (whole) break;
      done.events += std::ssize(packet->events);
      done.imu += std::ssize(packet->imu);
      extent.add(*packet);
      writer->add(*packet);
    }
  } catch (const DataError& e) {
    done.damage = e.what();
  }
  done.diagnostics.merge(reader->diagnostics());
  if (!whole && (replaces || !extent.first)) {
    done.kept_old = true;
    return done;
  }
  done.poses = convert_groundtruth(request, extent, *writer, done.diagnostics);
  writer->close();
  if (format == RecordingFormat::kText && rig)
    write_text_file(request.out / "camchain-imucam.yaml", rig_to_yaml(*rig));
  return done;
}

}  // namespace idol
