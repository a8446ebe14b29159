#include "idol/jobs/recording_run.hpp"

#include <fmt/format.h>

#include <chrono>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "idol/io/output_guard.hpp"
#include "idol/io/recording_judgement.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/jobs/run_truth.hpp"
#include "idol/report/frames.hpp"
#include "idol/report/report.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {
namespace {

using Clock = std::chrono::steady_clock;

Rig rig_of(const RunRequest& request, Diagnostics& diagnostics) {
  check_exists(request.sequence);
  if (!request.out.empty()) {
    InputPaths inputs;
    inputs.add_recording(request.sequence, request.choice, request.rig_path, request.imu_rig_path);
    inputs.refuse_output(request.out);
  }
  if (request.rig) return *request.rig;
  return load_rig(request.sequence, request.rig_path, request.imu_rig_path, &diagnostics,
                  stated_size(request.sequence, request.choice),
                  camera_choice(request.sequence, request.choice));
}

ReaderOptions reading_of(const RunRequest& request, const Rig& rig) {
  ReaderOptions reading;
  reading.width = rig.camera.width;
  reading.height = rig.camera.height;
  reading.from_s = request.from_s;
  reading.to_s = request.to_s;
  reading.imu_offset_s = rig.time_offset_s;
  reading.imu_near_events = true;
  reading.choice = request.choice;
  return reading;
}

/// Looks at the recording's beginning. The folder is taken before, so that a run that cannot write does not
/// read, and cleared after, so that a run that is refused leaves what was there.
Diagnostics check(const RunRequest& request, const Rig& rig) {
  if (!request.out.empty()) claim_folder(request.out, FolderContent::kRun);
  return check_recording(request.sequence, reading_of(request, rig), rig);
}

// Of the events from `from` on: at most a thousand, of one millisecond.
std::span<const Event> next_piece(const std::vector<Event>& events, std::size_t from) {
  constexpr std::size_t kMost = 1000;
  constexpr Time kLongest = kNsPerS / 1000;
  std::size_t to = from + 1;
  while (to < events.size() && to - from < kMost && events[to].t - events[from].t < kLongest) ++to;
  return {events.data() + from, to - from};
}

}  // namespace

RecordingRun::RecordingRun(RunRequest request, RunListeners listeners)
    : request_(std::move(request)),
      listeners_(std::move(listeners)),
      summary_{request_.sequence.string(), request_.preset, {}, 0, 0, {}},
      rig_(rig_of(request_, summary_.diagnostics)),
      checks_(check(request_, rig_)),
      reader_(open_reader(request_.sequence, reading_of(request_, rig_))),
      recorder_(request_.out, rig_, request_.rate_hz),
      monitor_(rig_.camera.width, rig_.camera.height),
      undistort_(rig_.camera),
      gyro_check_(rig_, undistort_),
      odometry_(rig_, request_.options) {
  checks_.merge(summary_.diagnostics);
  if (!request_.out.empty()) prepare_output();
  odometry_.on_estimate([this](const Estimate& e) {
    const Sight sight = sight_of(e, undistort_);
    recorder_.add(e, sight);
    gyro_check_.add(e);
    if (listeners_.estimate) listeners_.estimate(e);
    if (listeners_.sight) listeners_.sight(e, sight);
  });
}

// Clears the folder of an earlier run, whose results must not pass for those of this one.
void RecordingRun::prepare_output() {
  const auto& dir = request_.out;
  std::error_code error;
  for (const char* name : kRunFiles) std::filesystem::remove(dir / name, error);
  for (const char* name : {"pictures", "frames"}) remove_pictures(dir / name);
  std::vector<OptionField> fields;
  list_fields(request_.options, fields);
  write_text_file(dir / "config.yaml", dump_options(fields));
  write_text_file(dir / "rig.yaml", rig_to_yaml(rig_));
}

// In small pieces, which change no result, so that an interruption is heard soon; each in its own time if
// live.
void RecordingRun::push(const Packet& packet) {
  const Time offset = from_seconds(rig_.time_offset_s);
  auto sample = packet.imu.begin();
  for (std::size_t i = 0; i < packet.events.size() && !interrupted();) {
    const auto piece = next_piece(packet.events, i);
    i += piece.size();
    if (request_.live) recorder_.wait_until_due(piece.back().t);
    for (; sample != packet.imu.end() && sample->t <= piece.back().t + offset; ++sample) push(*sample);
    odometry_.push(piece);
    monitor_.add(piece);
    summary_.events += std::ssize(piece);
    if (listeners_.progress)
      listeners_.progress({reader_->progress(), recorder_.data_s(), summary_.events, recorder_.lines()});
  }
  for (; sample != packet.imu.end(); ++sample) push(*sample);
  if (reader_->imu_over()) odometry_.end_imu();
}

void RecordingRun::push(const ImuSample& sample) {
  gyro_check_.add(sample);
  odometry_.push(sample);
}

void RecordingRun::check_sensor() {
  check_sensor_fit(summary_.sequence, monitor_, rig_.camera, summary_.diagnostics);
}

RecordingRun::Outcome RecordingRun::feed() {
  constexpr std::int64_t kEnoughToJudge = 500000;  // events after which a wrong sensor would show
  Outcome outcome;
  bool judged = false;
  try {
    while (!interrupted()) {
      const auto begin = Clock::now();
      const auto packet = reader_->next();
      summary_.read_s += std::chrono::duration<double>(Clock::now() - begin).count();
      if (!packet) break;
      push(*packet);
      if (!judged && summary_.events >= kEnoughToJudge) {
        judged = true;
        check_sensor();
      }
    }
    if (!judged) check_sensor();
  } catch (const DataError& e) {
    outcome = {End::kBadData, e.what()};
  }
  try {
    interrupted() ? odometry_.wait() : odometry_.finish();
  } catch (const DataError& e) {
    if (outcome.end == End::kDone) outcome = {End::kBadData, e.what()};
  }
  if (interrupted()) return {End::kInterrupted, "interrupted: results so far are written"};
  return outcome;
}

RecordingRun::Outcome RecordingRun::explain_no_estimate() const {
  const Diagnostics heard = odometry_.diagnostics();
  const std::string why = heard.entries().empty() ? "events and IMU data are too few, or do not overlap"
                                                  : heard.entries().begin()->second.first_message;
  return {End::kBadData, fmt::format("{}: no window could be estimated: {}", summary_.sequence, why)};
}

// Of no consequence for the estimate: damage is a warning.
void RecordingRun::write_backdrops() {
  constexpr std::size_t kMostFrames = 240;
  const auto& states = odometry_.smoother().states();
  try {
    if (const auto frames = open_recording(request_.sequence, request_.choice)->frames())
      write_frames(*frames, rig_.camera, odometry_.smoother().time_offset_s(), states.front().t,
                   states.back().t, kMostFrames, request_.out / "frames");
  } catch (const std::runtime_error& e) {  // DataError, UsageError
    summary_.diagnostics.warn("bad_frames", e.what());
  }
}

// Results first, then what is said about them: even a damaged recording leaves what came before.
RecordingRun::Outcome RecordingRun::go() {
  Outcome outcome = feed();
  if (outcome.end == End::kDone && !odometry_.started()) outcome = explain_no_estimate();
  const bool write = !request_.out.empty();
  if (write) {
    if (odometry_.started()) write_backdrops();
    recorder_.write_results(odometry_);
  }
  summary_.status = outcome.end == End::kDone ? "done" : outcome.message;
  monitor_.report(summary_.sequence, summary_.diagnostics);
  summary_.diagnostics.merge(reader_->diagnostics());
  summary_.diagnostics.merge(odometry_.diagnostics());
  if (odometry_.started()) {
    gyro_check_.report(summary_.diagnostics);
    const TrackingFacts facts = recorder_.tracking();
    const auto stages = odometry_.front_end_stages();
    const bool at_rest = checks_.entries().contains("imu_still");
    if (!at_rest) report_tracking(facts, stages ? stages->explanation() : "", summary_.diagnostics);
    if (outcome.end == End::kDone && !at_rest && nothing_tracked(facts)) outcome.end = End::kNothingTracked;
  }
  summary_.diagnostics.merge_new(checks_);
  if (!write) return outcome;
  if (odometry_.started())
    figures_ =
        judge_against_truth(request_.sequence, request_.choice, rig_, request_.out, summary_.diagnostics);
  write_text_file(request_.out / "stats.json", stats_json());
  if (odometry_.started()) write_report(request_.out);
  return outcome;
}

}  // namespace idol
