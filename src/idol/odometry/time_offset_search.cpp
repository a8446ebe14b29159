#include "idol/odometry/time_offset_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace idol {
namespace {

constexpr double kPrior = 0.05;                          // standard deviation of the trial's time shift [s]
constexpr double kLargestCorrection = 0.2;               // correction [s]
constexpr double kLeastMotion = 0.8, kMostMotion = 1.5;  // before it is judged [s]
constexpr double kKnown = 0.003;  // standard deviation with which it is judged early [s]
constexpr double kNear = 0.012;   // what the estimator finds by itself [s]

Options trial_options(Options options) {
  options.backend.time_shift_sigma = kPrior;
  options.backend.last_pass_s = 0;
  return options;
}

}  // namespace

TimeOffsetSearch::TimeOffsetSearch(const Rig& rig, const Options& options, const UndistortMap& undistort,
                                   const ImuBuffer& imu)
    : rig_(rig), options_(trial_options(options)), undistort_(undistort), imu_(imu), gyro_(rig.camera) {}

void TimeOffsetSearch::make_trial() {
  trial_ = std::make_unique<WindowEstimator>(rig_, options_, undistort_);
  restarted_ = false;
}

void TimeOffsetSearch::start(const ImuInit& init, Time begin) {
  init_ = init;
  make_trial();
  trial_->start(init, begin);
}

TimeOffsetSearch::Progress TimeOffsetSearch::add(std::shared_ptr<const Segmented> segmented) {
  const EventWindow& window = segmented->window;
  const WindowEstimator::Outcome outcome = trial_->estimate(*segmented);
  restarted_ = outcome.stats.restarts > 0;
  windows_.push_back(segmented);
  if (outcome.still) {
    moving_s_ = 0;
    const Time needed = window.end - from_seconds(options_.start.duration_s);
    while (windows_.front()->window.begin < needed) windows_.pop_front();
    gyro_.drop_before(needed);
    return Progress::kResting;
  }
  gyro_.add(window, segmented->segments.segments);
  moving_s_ += seconds_between(window.begin, window.end);
  const Shift shift = shift_of_trial();
  const bool known = shift.valid && shift.sigma < kKnown;
  if (moving_s_ < (known ? kLeastMotion : kMostMotion)) return Progress::kMoving;
  judge();
  return Progress::kJudged;
}

Time TimeOffsetSearch::keep_from() const {
  if (windows_.empty()) return std::numeric_limits<Time>::max();
  return windows_.front()->window.begin - from_seconds(kLargestCorrection);
}

TimeOffsetSearch::Shift TimeOffsetSearch::shift_of_trial() const {
  const auto covariance = trial_->backend().covariance();
  if (!covariance) return {0, kPrior, false};
  constexpr Eigen::Index kTimeShift = 15;
  return {trial_->backend().latest().time_shift, std::sqrt((*covariance)(kTimeShift, kTimeShift)),
          !restarted_};
}

std::optional<GyroOffset::Result> TimeOffsetSearch::ask_gyro() const {
  const auto samples =
      imu_.slice(keep_from(), windows_.back()->window.end + from_seconds(kLargestCorrection), 0);
  return gyro_.search(camera_rates(samples, rig_));
}

void TimeOffsetSearch::judge() {
  if (windows_.empty() || moving_s_ == 0) return;
  constexpr double kFar = 0.04, kSigmas = 5;
  const Shift here = shift_of_trial();
  const auto gyro = ask_gyro();
  const bool gyro_contradicts = gyro && gyro->wrong_here();
  if (here.valid && std::abs(here.s) < std::max(kNear, kSigmas * here.sigma) && !gyro_contradicts) return;
  if (!here.valid && !gyro_contradicts) return;
  if (!gyro_contradicts && gyro && gyro->distinct && std::abs(gyro->offset_s) < kNear) return;
  const auto found = converge(gyro_contradicts ? gyro->offset_s : here.s);
  if (!found || std::abs(*found) < kNear) return;
  // What the gyro says clearly must agree.
  if (gyro && gyro->distinct && std::abs(gyro->offset_s - *found) > kFar) return;
  correction_s_ = *found;
}

// Moves the windows by what the trial finds, until it finds nothing.
std::optional<double> TimeOffsetSearch::converge(double offset_s) {
  constexpr int kMostTrials = 4;
  constexpr double kEnd = 0.004, kSure = 0.006;  // [s]
  for (int trial = 0; trial < kMostTrials && std::abs(offset_s) < kLargestCorrection; ++trial) {
    const Shift rest = try_offset(offset_s);
    if (!rest.valid) return std::nullopt;
    offset_s += rest.s;
    if (std::abs(rest.s) < kEnd && rest.sigma < kSure) return offset_s;
  }
  return std::nullopt;
}

TimeOffsetSearch::Shift TimeOffsetSearch::try_offset(double offset_s) {
  const Time offset = from_seconds(offset_s);
  make_trial();
  bool begun = false;
  for (const auto& segmented : windows_) {
    const Time begin = segmented->window.begin + offset, end = segmented->window.end + offset;
    if (imu_.empty() || begin < imu_.front_time() || !imu_.covers(end, options_.imu.margin_samples)) continue;
    if (!begun) {
      ImuInitOptions start = options_.start;
      if (!init_.still) start.still_gyro_std = 0;
      try {
        const auto samples = imu_.slice(begin, begin + from_seconds(start.duration_s), 0);
        trial_->start(initialise_from_imu(samples, options_.backend.gravity, start), begin);
      } catch (const DataError&) {
        return {};
      }
      begun = true;
    }
    Segmented moved = *segmented;
    shift(moved.window, offset);
    moved.samples = imu_.slice(begin, end, options_.imu.margin_samples);
    restarted_ = trial_->estimate(moved).stats.restarts > 0;
  }
  return begun ? shift_of_trial() : Shift{};
}

}  // namespace idol
