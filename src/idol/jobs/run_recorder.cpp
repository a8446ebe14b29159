#include "idol/jobs/run_recorder.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <thread>
#include <utility>

#include "idol/base/median.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/version.hpp"

namespace idol {
namespace {

nlohmann::json stages_json(const StageCounts& stages) {
  const DetectorCounts& d = stages.tracker.detector;
  nlohmann::json ended;
  for (std::size_t k = 0; k < kEndReasonNames.size(); ++k)
    ended[std::string(kEndReasonNames[k])] = stages.tracker.ended[k];
  return {
      {"fits", d.fits},
      {"fits_refused",
       {{"few_events", d.few},
        {"wide", d.wide},
        {"texture", d.texture},
        {"bent", d.bent},
        {"brief", d.brief}}},
      {"seeds", d.seeds},
      {"tracks", {{"born", stages.tracker.born}, {"validated", stages.tracker.validated}, {"ended", ended}}},
      {"segments",
       {{"reported", stages.reported},
        {"candidates", stages.candidates},
        {"wavy", stages.wavy},
        {"not_straight", stages.not_straight},
        {"few_events", stages.few_events}}},
      {"mean_sigma_px", stages.sigma_px},
      {"mean_speed_px_s", stages.speed_px_s}};
}

constexpr std::size_t kMaxSnapshots = 12;
constexpr int kPictureScale = 3;
constexpr double kLongestWait = 1.5;  // [s]: then poses are published, good or not

// Times of multiples of the period in (after, until].
std::vector<Time> ticks(Time after, Time until, double rate_hz) {
  const auto period = static_cast<Time>(kNsPerS / rate_hz);
  std::vector<Time> out;
  for (Time t = (after / period + 1) * period; t <= until; t += period) out.push_back(t);
  return out;
}

Trajectory imu_poses(const std::vector<NavState>& states) {
  Trajectory out;
  for (const auto& s : states) out.push_back({s.t, s.T_w_i});
  return out;
}

SegmenterCounts difference(SegmenterCounts a, const SegmenterCounts& b) {
  a.events -= b.events;
  a.in_segments -= b.in_segments;
  a.flicker -= b.flicker;
  a.hot -= b.hot;
  a.unsupported -= b.unsupported;
  a.thinned -= b.thinned;
  return a;
}

double peak_rss_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024;
}

}  // namespace

RunRecorder::RunRecorder(std::filesystem::path dir, const Rig& rig, double rate_hz)
    : dir_(std::move(dir)), rig_(rig), rate_hz_(rate_hz), event_log_(rig.camera.width, rig.camera.height) {
  constexpr double kMost = 1e6;  // beyond it, poses are nearer to each other than any clock tells
  if (!(rate_hz >= 0 && rate_hz <= kMost))
    throw UsageError(
        fmt::format("a rate of {} Hz for the trajectories: up to {:.0f} Hz is possible", rate_hz, kMost));
}

void RunRecorder::publish(const Estimate& e) {
  const Time first = rows_.empty() ? e.window.begin : rows_.front().begin();
  if (causal_.empty() && !e.stats.settled && seconds_between(first, e.state.t) < kLongestWait) return;
  const std::size_t published = causal_.size();
  if (rate_hz_ > 0) {
    const Time after = causal_.empty() ? e.window.begin - 1 : causal_.back().t;
    for (Time t : ticks(after, e.state.t, rate_hz_)) causal_.push_back(e.smoother.state_at(t));
  } else {
    causal_.push_back(e.state);
  }
  for (std::size_t k = published; k < causal_.size(); ++k) {
    const StampedPose pose = e.smoother.camera_pose(causal_[k]);
    // The camera's clock steps back where the time offset is corrected; what was published stays.
    if (causal_camera_.empty() || pose.t > causal_camera_.back().t) causal_camera_.push_back(pose);
  }
}

void RunRecorder::add(const Estimate& e, const Sight& sight) {
  publish(e);
  Row row{e.window.end,
          seconds_between(e.window.begin, e.window.end),
          e.window.events.size() - e.window.overlap + e.window.flicker,
          e.segments.segments.size(),
          sight.lines.size(),
          difference(e.counts, counts_),
          e.segments.speed_px_s,
          e.stats,
          StateVec::Zero(),
          e.segment_s,
          e.integrate_s,
          e.solve_s};
  counts_ = e.counts;
  if (const auto covariance = e.smoother.covariance()) row.sigma = covariance->diagonal().cwiseSqrt();
  if (replay_ && !e.window.events.empty()) {
    const Time last = e.window.events.back().t - from_seconds(e.smoother.time_offset_s());
    row.latency_s = std::chrono::duration<double>(Clock::now() - replay_->begin).count() -
                    seconds_between(replay_->first, last);
  }
  {
    const std::lock_guard lock(rows_mutex_);
    rows_.push_back(row);
  }
  if (dir_.empty()) return;
  event_log_.add(sight.t, row.events, sight.events);
  if ((rows_.size() - 1) % snapshot_every_ == 0) take_snapshot(e, sight);
}

void RunRecorder::wait_until_due(Time event) {
  if (!replay_) replay_ = Replay{event, Clock::now()};
  std::this_thread::sleep_until(replay_->begin + std::chrono::nanoseconds(event - replay_->first));
}

std::optional<RunRecorder::Latency> RunRecorder::latency() const {
  if (!replay_ || rows_.empty()) return std::nullopt;
  std::vector<double> sorted;
  // Windows that ended while the start was still gathering IMU data waited for it, not for the estimator.
  const double started = seconds_between(replay_->first, rows_.front().t) + rows_.front().latency_s;
  for (const Row& row : rows_)
    if (seconds_between(replay_->first, row.t) > started) sorted.push_back(row.latency_s);
  if (sorted.empty()) return std::nullopt;
  std::sort(sorted.begin(), sorted.end());
  return Latency{sorted[sorted.size() / 2], sorted[sorted.size() * 99 / 100], sorted.back()};
}

TrackingFacts RunRecorder::tracking() const {
  constexpr std::size_t kFew = 3;  // lines that hold a pose in some directions at least
  constexpr double kShare =
      0.2;  // of the segments: of what moves as expected, four in five are landmarks soon
  TrackingFacts facts;
  std::vector<double> speeds;
  for (const Row& row : rows_) {
    facts.duration_s += row.duration_s;
    facts.events += static_cast<std::int64_t>(row.events);
    facts.noise += row.counts.hot + row.counts.unsupported;
    if (row.segments >= kFew) {
      facts.moving_s += row.duration_s;
      speeds.push_back(row.speed_px_s);
    }
    if (row.lines_seen >= kFew &&
        static_cast<double>(row.lines_seen) >= kShare * static_cast<double>(row.segments))
      facts.tracked_s += row.duration_s;
  }
  if (!rows_.empty()) facts.restarts = rows_.back().stats.restarts;
  if (!speeds.empty()) facts.median_speed_px_s = median(speeds);
  return facts;
}

// From the first event on.
std::optional<double> RunRecorder::first_good_pose_s() const {
  const auto good =
      std::find_if(rows_.begin(), rows_.end(), [](const Row& row) { return row.stats.settled; });
  if (good == rows_.end()) return std::nullopt;
  return seconds_between(rows_.front().begin(), good->t);
}

// Events around the window's middle, and the lines where they were then.
void RunRecorder::take_snapshot(const Estimate& e, const Sight& sight) {
  if (snapshots_.size() == kMaxSnapshots) {
    // Keep every other one and go on at half the pace: evenly spread, however long the run.
    for (std::size_t i = 0; 2 * i < snapshots_.size(); ++i) snapshots_[i] = std::move(snapshots_[2 * i]);
    snapshots_.resize((snapshots_.size() + 1) / 2);
    snapshot_every_ *= 2;
    if ((rows_.size() - 1) % snapshot_every_ != 0) return;
  }
  Snapshot shot;
  shot.window = rows_.size() - 1;
  shot.t = sight.t;
  shot.events = sight.events;
  const Projection& projection = e.smoother.projection();
  const Pose T_c_w = sight.T_w_c.inverse();
  for (const Line& line : sight.lines) {
    const Vec3 a = T_c_w * line.a, b = T_c_w * line.b;
    if (a.z() > 0.05 && b.z() > 0.05)
      shot.lines.push_back({projection.camera.project(a), projection.camera.project(b), line.id});
  }
  snapshots_.push_back(std::move(shot));
}

void RunRecorder::write_results(const Odometry& odometry) const {
  if (!odometry.started()) return;
  write_trajectories(odometry);
  write_windows();
  write_pictures();
  event_log_.write(dir_ / "events_shown.bin");
}

RunRecorder::Trajectories RunRecorder::trajectories(const Odometry& odometry) const {
  if (!odometry.started()) return {};
  const Backend& smoother = odometry.smoother();
  std::vector<NavState> smoothed = smoother.states();
  if (rate_hz_ > 0) {
    smoothed.clear();
    for (Time t : ticks(smoother.states().front().t - 1, smoother.latest().t, rate_hz_))
      smoothed.push_back(smoother.state_at(t));
  }
  Trajectory camera;
  for (const NavState& state : smoothed) camera.push_back(smoother.camera_pose(state));
  return {imu_poses(smoothed), std::move(camera), imu_poses(causal_), causal_camera_};
}

void RunRecorder::write_trajectories(const Odometry& odometry) const {
  const Backend& smoother = odometry.smoother();
  const Trajectories all = trajectories(odometry);
  write_trajectory(dir_ / "trajectory_imu.txt", all.imu);
  write_trajectory(dir_ / "trajectory_camera.txt", all.camera);
  write_trajectory(dir_ / "trajectory_imu_causal.txt", all.imu_causal);
  write_trajectory(dir_ / "trajectory_camera_causal.txt", all.camera_causal);
  write_states(dir_ / "states.csv", smoother.states());
  write_states(dir_ / "states_causal.csv", causal_);
  Rig refined = rig_;
  refined.T_i_c = smoother.projection().T_i_c;
  refined.camera = smoother.projection().camera;
  refined.time_offset_s = smoother.time_offset_s() + smoother.latest().time_shift;
  write_text_file(dir_ / "rig_refined.yaml", rig_to_yaml(refined));
  const auto lines = smoother.lines();
  write_lines_csv(dir_ / "lines.csv", lines);
  write_lines_ply(dir_ / "lines.ply", lines);
}

void RunRecorder::write_windows() const {
  std::string text =
      "t,duration_s,events,in_segments,flicker,hot,unsupported,thinned,segments,lines_seen,speed_px_s,lines,"
      "residuals,"
      "iterations,cost,rms_px,mean_track_s,segment_s,integrate_s,solve_s,latency_s,restarts,settled,"
      "sigma_px,sigma_py,sigma_pz,sigma_rx,sigma_ry,sigma_rz,sigma_vx,sigma_vy,sigma_vz,"
      "sigma_bgx,sigma_bgy,sigma_bgz,sigma_bax,sigma_bay,sigma_baz,sigma_time_shift,sigma_event_lag\n";
  for (const auto& r : rows_) {
    const SegmenterCounts& n = r.counts;
    text += fmt::format("{},{:.6f},{},{},{},{},{},{},{},{},{:.2f}", format_stamp(r.t), r.duration_s, r.events,
                        n.in_segments, n.flicker, n.hot, n.unsupported, n.thinned, r.segments, r.lines_seen,
                        r.speed_px_s);
    text += fmt::format(",{},{},{},{:.6g},{:.4f},{:.4f}", r.stats.lines, r.stats.residuals,
                        r.stats.iterations, r.stats.cost, r.stats.rms_px, r.stats.mean_track_s);
    text +=
        fmt::format(",{:.6f},{:.6f},{:.6f},{},{},{:d}", r.segment_s, r.integrate_s, r.solve_s,
                    replay_ ? fmt::format("{:.6f}", r.latency_s) : "nan", r.stats.restarts, r.stats.settled);
    for (double sigma : r.sigma) text += fmt::format(",{:.4g}", sigma);
    text += '\n';
  }
  write_text_file(dir_ / "windows.csv", text);
}

void RunRecorder::write_pictures() const {
  const auto folder = dir_ / "pictures";
  claim_and_clear_pictures(folder);
  for (const auto& shot : snapshots_) {
    const double t = seconds_between(snapshots_.front().t, shot.t);
    write_png(
        folder / fmt::format("window_{:05}_{:.2f}.png", shot.window, t),
        draw_event_picture(rig_.camera.width, rig_.camera.height, shot.events, shot.lines, kPictureScale));
  }
}

std::string RunRecorder::stats_json(const Odometry& odometry, const Summary& summary) const {
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin_).count();
  Row total;
  std::int64_t iterations = 0, peak_residuals = 0;
  for (const auto& r : rows_) {
    total.duration_s += r.duration_s;
    total.segment_s += r.segment_s;
    total.integrate_s += r.integrate_s;
    total.solve_s += r.solve_s;
    iterations += r.stats.iterations;
    peak_residuals = std::max<std::int64_t>(peak_residuals, r.stats.residuals);
  }
  nlohmann::ordered_json stats;
  stats["version"] = kVersion;
  stats["sequence"] = summary.sequence;
  stats["preset"] = summary.preset;
  stats["status"] = summary.status;
  stats["events"] = summary.events;
  stats["duration_s"] = total.duration_s;
  stats["wall_s"] = wall;
  stats["realtime_factor"] = wall > 0 ? total.duration_s / wall : 0;
  stats["peak_rss_mb"] = peak_rss_mb();
  stats["stages"] = {{"read", summary.read_s},
                     {"segment", total.segment_s},
                     {"integrate", total.integrate_s},
                     {"solve", total.solve_s}};
  const SegmenterCounts counts = odometry.event_counts();
  stats["front_end"] = {{"events", counts.events},           {"in_segments", counts.in_segments},
                        {"flicker", counts.flicker},         {"hot_pixels", counts.hot},
                        {"unsupported", counts.unsupported}, {"thinned", counts.thinned}};
  if (const auto stages = odometry.front_end_stages()) stats["front_end"]["stages"] = stages_json(*stages);
  if (odometry.started()) {
    stats["time_shift_s"] =
        odometry.smoother().time_offset_s() + odometry.smoother().latest().time_shift - rig_.time_offset_s;
    stats["event_lag_px"] = odometry.smoother().latest().event_lag_px;
  }
  if (const auto live = latency())
    stats["latency_s"] = {{"median", live->median}, {"p99", live->p99}, {"worst", live->worst}};
  stats["windows"] = rows_.size();
  stats["lines"] = odometry.started() ? odometry.smoother().line_count() : 0;
  stats["residuals"] = peak_residuals;
  stats["solver_iterations"] = iterations;
  stats["restarts"] = rows_.empty() ? 0 : rows_.back().stats.restarts;
  if (const auto first = first_good_pose_s()) stats["first_good_pose_s"] = *first;
  stats["warnings"] = nlohmann::ordered_json::object();
  for (const auto& [kind, entry] : summary.diagnostics.entries())
    stats["warnings"][kind] = {{"message", entry.first_message}, {"count", entry.count}};
  // A path need not be UTF-8, as JSON must be.
  return stats.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace idol
