#include "idol/backend/fixed_lag.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace idol {
namespace {

constexpr double kEnoughOnTheWay = 1e-2;  // the next window solves again
constexpr double kEnoughAtLast = 1e-4;
constexpr std::size_t kLagToSettle = 3;  // times the usual, until a start in motion is settled

}  // namespace

FixedLag::FixedLag(const Rig& rig, const BackendOptions& options)
    : Backend(rig, options.gravity),
      options_(options),
      nominal_(projection_),
      camera_dim_(options.refine_calibration ? 4 : 0),
      imu_dim_(options.refine_imu ? kImuIntrinsicsDim : 0),
      calibration_dim_(camera_dim_ + imu_dim_) {
  calibration_.setZero(calibration_dim_);
}

void FixedLag::add(WindowMeasurement window) {
  const std::size_t index = windows_.size();
  append(window);
  const Preintegration& imu = *window.imu;
  const Mat9 covariance = std::pow(options_.imu_noise_factor, 2) * imu.covariance(imu.end());
  const Mat9 whitening = covariance.llt().matrixL().solve(Mat9::Identity());
  const Preintegrated motion = imu.at(imu.end());
  inertial_.push_back(std::make_unique<Inertial>(Inertial{motion,
                                                          imu.bias(),
                                                          bias_by_intrinsics(motion),
                                                          whitening,
                                                          whitening.transpose() * whitening,
                                                          std::move(window.bin_motions),
                                                          {}}));
  move_cameras();
  predict_end(index);  // with the intrinsics
  for (auto& seen : window.lines) file(index, std::move(seen));
  const bool known = std::any_of(tracks_.begin(), tracks_.end(), [&](const auto& entry) {
    return entry.second.mapped && !entry.second.dead && entry.second.last_window == index &&
           entry.second.windows > 0;
  });
  // Before the first lines the IMU is alone anyway.
  blind_s_ = known || windows_.back().still || line_count() == 0
                 ? 0
                 : blind_s_ + seconds_between(imu.begin(), imu.end());
}

// Under its own id, or that of the known line it lies on.
void FixedLag::file(std::size_t window, LineObservation&& seen) {
  LineId id = seen.id;
  if (const auto it = alias_.find(id); it != alias_.end()) id = it->second;
  auto found = tracks_.find(id);
  if (!seen.candidate && (found == tracks_.end() || !found->second.mapped)) {
    if (const auto known = known_line(seen, window)) {
      alias_[seen.id] = *known;
      if (found != tracks_.end()) tracks_.erase(found);
      found = tracks_.find(*known);
    }
  }
  if (found == tracks_.end()) found = tracks_.try_emplace(id).first;
  Track& track = found->second;
  if (track.dead) return;
  if (track.archived) {  // the tracker has found it again by itself
    track.archived = false;
    map_.erase(id);
  }
  track.sure = track.sure || !seen.candidate;
  if (track.windows == 0) track.first_window = window;
  if (track.windows == 0 || track.last_window != window) ++track.windows;
  track.last_window = window;
  track.events += seen.event_count;
  track.seen.push_back({window, std::move(seen.bins), false});
  track.end_a = seen.end_a;
  track.end_b = seen.end_b;
}

SolveStats FixedLag::solve() {
  const std::size_t lag = static_cast<std::size_t>(options_.lag_windows) * (settled_ ? 1 : kLagToSettle);
  forget();
  while (states_.size() - first_ > lag + 1) marginalise_oldest();
  make_lines();
  const std::vector<LineId> ids = active_lines();
  const MarginalPrior::Reduction reduction = prior_.reduced(ids);
  const ActivePrior active(reduction.prior);
  // While everything is in the lag a bad start can still be undone, which takes longer.
  const int iterations = first_ == begun_ ? 2 * options_.max_iterations : options_.max_iterations;
  SolveStats stats = settled_ ? optimise(ids, active, iterations, kEnoughOnTheWay)
                              : optimise(ids, active, kIterationsToSettle, kEnoughToSettle);
  if (!settled_ && first_ == begun_) stats = try_other_starts(stats, ids, active);
  update_dormant_lines(reduction);
  cull();
  measure_extents();
  if (settled_ && options_.redetect_px > 0) associate_with_map();
  misfit_s_ = newest_misfits() ? misfit_s_ + seconds_between(states_.end()[-2].t, states_.back().t) : 0;
  if (lost()) restart();
  settled_ = settled_ || knows_velocity();
  const SolveStats newest = newest_stats();
  stats.restarts = restarts_;
  stats.settled = settled_;
  stats.rms_px = newest.rms_px;
  stats.mean_track_s = newest.mean_track_s;
  return stats;
}

// Levenberg-Marquardt, hardly damped: the start is a prediction away from the optimum. Ends with a step that
// gains less than the share `enough` of the cost.
SolveStats FixedLag::optimise(const std::vector<LineId>& ids, const ActivePrior& prior, int max_iterations,
                              double enough) {
  SolveStats stats;
  stats.lines = static_cast<int>(ids.size());
  for (LineId id : ids)
    for (const auto& seen : tracks_.at(id).seen) stats.residuals += 2 * static_cast<int>(seen.bins.size());
  constexpr double kLeast = 1e-13, kMost = 1e3;
  double damping = kLeast;
  ChainSystem system = linearise(ids, prior);
  stats.cost = system.cost;
  while (stats.iterations < max_iterations) {
    ++stats.iterations;
    const Variables before = variables(ids);
    const auto step = system.solve(damping);
    double gain = -1;
    if (!step.states.empty()) {
      if (damping <= kLeast) covariance_ = step.last_covariance;
      apply(step, ids);
      stats.cost = cost(ids, prior);
      gain = system.cost - stats.cost;
    }
    if (!(gain >= 0)) {  // back, and more carefully
      set_variables(before, ids);
      stats.cost = system.cost;
      damping = std::max(1e-6, 30 * damping);
      if (damping > kMost) break;
      continue;
    }
    damping = std::max(kLeast, damping / 10);
    if (gain < enough * (1 + std::abs(stats.cost)) || stats.iterations == max_iterations) break;
    system = linearise(ids, prior);
  }
  return stats;
}

bool FixedLag::keeps_past() const {
  return seconds_between(states_[begun_].t, states_.back().t) <= options_.last_pass_s;
}

SolveStats FixedLag::finish() {
  if (!keeps_past() || begun_ + 1 >= states_.size()) return {};
  // By descending id a line that was continued more than once hands on everything.
  for (auto it = tracks_.rbegin(); it != tracks_.rend(); ++it) {
    Track& track = it->second;
    const auto take = [&](std::vector<PastObservation>& past) {
      std::vector<Observation> before;
      for (const PastObservation& seen : past) before.push_back(seen.observation());
      track.seen.insert(track.seen.begin(), std::make_move_iterator(before.begin()),
                        std::make_move_iterator(before.end()));
      std::vector<PastObservation>().swap(past);
    };
    take(track.past);
    while (track.tie) {
      Track& source = tracks_.at(track.tie->source.id);
      take(source.past);
      track.tie = std::move(source.tie);
      source.tie.reset();
    }
  }
  first_ = begun_;
  prior_ = gauge_;
  move_cameras();
  SolveStats stats;
  constexpr int kRounds = 3, kIterations = 4;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<LineId> ids = longest(active_lines());
    const int before = stats.iterations;
    stats = optimise(ids, ActivePrior(prior_), kIterations, kEnoughAtLast);
    stats.iterations += before;
    cull();
  }
  return stats;
}

// Mapped lines with something to say about the active states.
std::vector<LineId> FixedLag::active_lines() const {
  std::vector<LineId> ids;
  for (const auto& [id, track] : tracks_)
    if (track.mapped && !track.dead &&
        std::any_of(track.seen.begin(), track.seen.end(), [](const Observation& o) { return !o.rejected; }))
      ids.push_back(id);
  return ids;
}

// As many lines, seen longest, as a last pass can take without needing long or much memory: its work grows
// with the states times the square of the lines.
std::vector<LineId> FixedLag::longest(std::vector<LineId> ids) const {
  constexpr double kWork = 2e8;  // 400 lines over a minute, 700 over 20 s
  const auto most = static_cast<std::size_t>(std::sqrt(kWork / static_cast<double>(states_.size() - first_)));
  if (ids.size() <= most) return ids;
  std::stable_sort(ids.begin(), ids.end(),
                   [&](LineId a, LineId b) { return tracks_.at(a).windows > tracks_.at(b).windows; });
  ids.resize(most);
  std::sort(ids.begin(), ids.end());
  return ids;
}

// In pixels of a thin edge: what a thick one may be off counts less.
double FixedLag::rms_px(const Track& track, const Observation& seen) const {
  double sum = 0;
  int rows = 0;
  for (const auto& bin : seen.bins) {
    const auto d = distances(bin, track.line, seen.window);
    if (!d) continue;
    sum += d->squaredNorm() / std::pow(widening(bin), 2);
    rows += 2;
  }
  return rows == 0 ? 1e6 : std::sqrt(sum / rows);
}

// Leaves out what does not fit. A line that keeps less than half of what it saw lately, or has gone to
// infinity or behind the camera that made it, is dead.
void FixedLag::cull() {
  for (auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead || track.seen.empty()) continue;
    std::ptrdiff_t kept = 0;
    for (auto& seen : track.seen) {
      seen.rejected = rms_px(track, seen) > options_.cull_px;
      if (!seen.rejected) ++kept;
    }
    track.dead = 2 * kept < std::ssize(track.seen) || !track.line.finite();
    if (track.dead) release(track);
  }
}

std::vector<Line> FixedLag::lines() const {
  std::vector<Line> out;
  for (const auto& [id, track] : tracks_)
    if (track.mapped && !track.dead && !track.continued && track.line.finite())
      out.push_back(line_of(id, track));
  return out;
}

std::size_t FixedLag::line_count() const {
  return static_cast<std::size_t>(std::count_if(tracks_.begin(), tracks_.end(), [](const auto& entry) {
    return entry.second.mapped && !entry.second.dead && !entry.second.continued;
  }));
}

SolveStats FixedLag::newest_stats() const {
  SolveStats stats;
  int seen = 0;
  double squares = 0;
  for (const auto& [id, track] : tracks_) {
    if (!in_sight(track)) continue;
    ++seen;
    squares += std::pow(rms_px(track, track.seen.back()), 2);
    stats.mean_track_s += seconds_between(states_[track.first_window].t, states_.back().t);
  }
  if (seen == 0) return stats;
  stats.rms_px = std::sqrt(squares / seen);
  stats.mean_track_s /= seen;
  return stats;
}

}  // namespace idol
