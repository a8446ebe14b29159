#include "idol/odometry/odometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "idol/base/stopwatch.hpp"

namespace idol {
namespace {

constexpr std::size_t kMostWaiting = 4;  // windows between the front-end and the back-end
constexpr double kImuTail = 0.05;        // [s]: events after the last IMU sample that nobody will miss
constexpr double kShortestWindow =
    0.005;  // [s]: what is left at the end of the data and shorter is not estimated

// Ends the window earlier.
void shorten(EventWindow& window, Time end) {
  window.end = end;
  std::erase_if(window.events, [&](const Event& e) { return e.t >= end; });
  window.overlap = std::min(window.overlap, window.events.size());
}

}  // namespace

Odometry::Odometry(const Rig& rig, const Options& options)
    : rig_(rig),
      options_(options),
      event_check_(InputCheck<Event>(rig.camera.width, rig.camera.height)),
      undistort_(rig.camera),
      imu_(options.imu.max_gap_s),
      windower_(options.window),
      segmenter_(make_segmenter(options.segment, undistort_)),
      estimator_(rig, options, undistort_) {
  if (options.backend.find_time_offset && options.backend.method == BackendMethod::kFixedLag)
    offset_search_ = std::make_unique<TimeOffsetSearch>(rig_, options_, undistort_, imu_);
  if (options.filter.flicker) flicker_filter_.emplace(rig.camera.width, rig.camera.height);
  if (options.pipeline.threads > 1) background_ = std::make_unique<Background>(kMostWaiting);
}

void Odometry::push(const ImuSample& sample) {
  if (!imu_check_.take(sample, diagnostics_)) return;
  imu_.push(sample);
  process_ready(false);
}

void Odometry::push(std::span<const Event> events) {
  const Time offset = from_seconds(rig_.time_offset_s);
  for (Event event : events) {
    if (!event_check_.take(event, diagnostics_)) continue;
    event.t += offset;
    if (flicker_filter_)
      flicker_filter_->push(event, [this](const Event& e, bool is_flicker) { take(e, is_flicker); });
    else
      windower_.push({&event, 1});
  }
  process_ready(imu_over_);
  prepare();
}

void Odometry::take(const Event& event, bool is_flicker) {
  if (is_flicker)
    windower_.leave_out_flicker(event.t);
  else
    windower_.push({&event, 1});
}

void Odometry::end_imu() {
  imu_over_ = true;
  imu_.flush();
  process_ready(true);
}

void Odometry::finish() {
  imu_.flush();
  if (flicker_filter_)
    flicker_filter_->finish([this](const Event& e, bool is_flicker) { take(e, is_flicker); });
  process_ready(true);
  if (auto window = windower_.flush()) {
    waiting_ = std::move(window);
    process_ready(true);
  }
  take_up(true);
  wait();
  if (!started_ && !start_failure_.empty()) throw DataError(start_failure_);
  if (started()) estimator_.backend().finish();
}

void Odometry::wait() {
  if (background_) background_->drain();
}

// A window is taken up once the IMU covers it and the margin behind it, however the data were cut into
// packets.
void Odometry::process_ready(bool last) {
  while (waiting_ || (waiting_ = windower_.pop())) {
    const EventWindow& window = *waiting_;
    if (imu_.empty()) {
      if (!last) return;
    } else if (window.begin + correction_ < imu_.front_time() && !started_) {
      diagnostics_.warn("events_before_imu",
                        fmt::format("the IMU starts at {:.3f} s: earlier events are not used",
                                    static_cast<double>(imu_.front_time()) / kNsPerS));
      waiting_.reset();
      continue;
    }
    if (!imu_.covers(window.end + correction_, last ? 1 : options_.imu.margin_samples)) {
      if (!last) return;
      if (!imu_.empty() && seconds_between(window.begin + correction_, imu_.back_time()) > kShortestWindow) {
        shorten(*waiting_, imu_.back_time() - correction_);
        continue;
      }
      drop_waiting();
      continue;
    }
    segment(*std::exchange(waiting_, std::nullopt));
  }
}

// Labels events before their window is complete, so that little is left to do when it is.
void Odometry::prepare() {
  constexpr Time kEvery = kNsPerS / 500;
  if (!started_) return;
  const EventWindow& window = waiting_ ? *waiting_ : windower_.open();
  if (window.events.empty()) return;
  const Time until = std::min(window.events.back().t, imu_.back_time() - correction_);
  if (until <= window.begin || until < prepared_ + kEvery) return;
  prepared_ = until;
  Stopwatch watch;
  segmenter_->prepare(window, rates_of(imu_samples(window.begin + correction_, until + correction_)));
  prepare_s_ += watch.lap();
}

// A window that the IMU will never reach.
void Odometry::drop_waiting() {
  if (imu_.empty()) {
    diagnostics_.warn("no_imu", "there is no IMU data: nothing is estimated");
  } else if (seconds_between(imu_.back_time(), waiting_->end + correction_) > kImuTail) {
    diagnostics_.warn("imu_ends_early", fmt::format("the IMU ends at {:.3f} s, before the events: nothing is "
                                                    "estimated after it",
                                                    static_cast<double>(imu_.back_time()) / kNsPerS));
  }
  waiting_.reset();
}

// The start is found from the first windows together; after a violent motion, from later ones.
bool Odometry::find_start(bool last) {
  while (!init_ && !held_.empty()) {
    const Time begin = held_.front()->window.begin, until = begin + from_seconds(options_.start.duration_s);
    if (held_.back()->window.end < until && !last) return false;
    ImuInitOptions options = options_.start;
    // Whatever the IMU says.
    if (!options_.backend.use_rest || image_moves(until)) options.still_gyro_std = 0;
    try {
      init_ = initialise_from_imu(imu_.slice(begin, until, 0), options_.backend.gravity, options);
      if (offset_search_) offset_search_->start(*init_, begin);
    } catch (const ViolentStart& e) {
      if (start_failure_.empty()) start_failure_ = e.what();
      held_.pop_front();
      if (!held_.empty()) imu_.drop_before(held_.front()->window.begin, 2 * options_.imu.margin_samples);
    }
  }
  return init_.has_value();
}

// Steadily, before `until`, so that the IMU alone would think it at rest. Something that passes before a
// camera at rest does not fill the image.
bool Odometry::image_moves(Time until) const {
  constexpr double kSpread = 0.4;  // of width and height
  ImageMotion motion(rig_.camera.width, rig_.camera.height);
  // What is noise and what is a line is known after a while.
  const Time known = held_.front()->window.begin + from_seconds(0.5 * options_.start.duration_s);
  for (const auto& segmented : held_) {
    motion.add(segmented->window, segmented->segments);
    if (segmented->window.end > known && motion.moves(kSpread)) return true;
    if (segmented->window.end >= until) return false;
  }
  return false;
}

// Windows wait until the start is known, and in the first second of motion until the time offset is judged:
// nothing but a rest has been estimated with a wrong one then.
void Odometry::take_up(bool last) {
  if (!find_start(last)) return;
  for (; offset_search_ && searched_ < held_.size();) {
    const auto progress = offset_search_->add(held_[searched_++]);
    if (progress == TimeOffsetSearch::Progress::kResting) hand_over_held(last);
    if (progress == TimeOffsetSearch::Progress::kJudged) correct_time_offset();
  }
  if (offset_search_ && last) {
    offset_search_->judge();
    correct_time_offset();
  }
  if (!offset_search_ && find_start(last)) hand_over_held(last);
}

// By what the search has found, from the windows that are held on.
void Odometry::correct_time_offset() {
  const double correction_s = offset_search_->correction_s();
  offset_search_.reset();
  if (correction_s == 0) return;
  correction_ = from_seconds(correction_s);
  diagnostics_.warn(
      "time_offset",
      fmt::format("camera and IMU stamps are {:.0f} ms apart beyond what the rig says "
                  "(time offset {:.0f} ms): corrected to {:.0f} ms",
                  1e3 * correction_s, 1e3 * rig_.time_offset_s, 1e3 * (rig_.time_offset_s + correction_s)));
  for (auto& segmented : held_) {
    shift(segmented->window, correction_);
    segmented->samples.clear();
  }
  const Time from = started_ ? handed_over_until_ : imu_.front_time();
  while (!held_.empty() && held_.front()->window.begin < from) held_.pop_front();
  if (!started_) {
    init_.reset();
    estimator_.add_time_offset(correction_s);
    return;
  }
  // From the end of the rest to the first window, the IMU alone.
  if (!held_.empty() && held_.front()->window.begin > from) {
    auto between = std::make_shared<Segmented>();
    between->window.begin = from;
    between->window.end = held_.front()->window.begin;
    between->counts = held_.front()->counts;
    held_.push_front(std::move(between));
  }
  run([this, correction_s] { estimator_.add_time_offset(correction_s); });
}

// As far as the IMU covers them: those that were moved may lie ahead of it.
void Odometry::hand_over_held(bool last) {
  if (!started_ && !held_.empty()) start();
  for (; !held_.empty(); held_.pop_front()) {
    auto& segmented = held_.front();
    const EventWindow& window = segmented->window;
    if (segmented->samples.empty()) {
      if (!imu_.covers(window.end, last ? 1 : options_.imu.margin_samples)) break;
      segmented->samples = imu_samples(window.begin, window.end);
    }
    handed_over_until_ = window.end;
    run([this, segmented = std::shared_ptr<const Segmented>(std::move(segmented))] { estimate(*segmented); });
  }
  searched_ = 0;
}

void Odometry::start() {
  const Time begin = held_.front()->window.begin;
  estimator_.start(*init_, begin);
  started_ = true;
  if (!start_failure_.empty())
    diagnostics_.warn("late_start", fmt::format("nothing is estimated before {:.3f} s: {}",
                                                static_cast<double>(begin) / kNsPerS, start_failure_));
  if (!init_->still)
    diagnostics_.warn("moving_start",
                      fmt::format("the recording does not start at rest (rate spread {:.3f} rad/s, force "
                                  "spread {:.2f} m/s^2): the first seconds may be poor",
                                  init_->gyro_std, init_->accel_std));
}

std::vector<ImuSample> Odometry::imu_samples(Time from, Time to) const {
  return imu_.slice(from, to, options_.imu.margin_samples);
}

// By the front-end's clock: the camera's, with the rig's offset.
std::vector<CameraRate> Odometry::rates_of(std::span<const ImuSample> samples) const {
  std::vector<CameraRate> rates = camera_rates(samples, rig_);
  for (CameraRate& rate : rates) rate.t -= correction_;
  return rates;
}

// What the front-end makes of a window depends on nothing that the back-end finds: both can work at a time.
void Odometry::segment(EventWindow&& window) {
  Stopwatch watch;
  auto done = std::make_shared<Segmented>();
  done->samples = imu_samples(window.begin + correction_, window.end + correction_);
  done->segments = segmenter_->process(window, rates_of(done->samples));
  done->window = std::move(window);
  if (correction_ != 0) shift(done->window, correction_);
  done->counts = segmenter_->counts();
  done->segment_s = watch.lap() + std::exchange(prepare_s_, 0);
  // What carries the newest estimate on stays, and what windows may yet be moved to.
  if (const auto known = newest()) {
    Time keep = std::min(done->window.end, known->t);
    if (offset_search_) keep = std::min(keep, offset_search_->keep_from());
    imu_.drop_before(keep, 2 * options_.imu.margin_samples);
  }
  held_.push_back(std::move(done));
  take_up(false);
}

void Odometry::run(std::function<void()> job) {
  if (background_) {
    background_->run(std::move(job));
    return;
  }
  // As in the second thread: what throws leaves things half done, and is the last.
  if (std::exchange(failed_, true))
    throw UsageError("the estimation has ended with an error: make another Odometry");
  job();
  failed_ = false;
}

void Odometry::estimate(const Segmented& segmented) {
  const WindowEstimator::Outcome outcome = estimator_.estimate(segmented);
  const Backend& backend = estimator_.backend();
  {
    const std::lock_guard lock(newest_mutex_);
    newest_ = backend.latest();
  }
  if (listener_)
    listener_({backend.latest(), segmented.window, segmented.segments, backend, outcome.stats,
               segmented.segment_s, outcome.integrate_s, outcome.solve_s, segmented.counts});
}

std::optional<NavState> Odometry::newest() const {
  const std::lock_guard lock(newest_mutex_);
  return newest_;
}

std::optional<NavState> Odometry::predict_at(Time t) const {
  const auto from = newest();
  if (!from || t < from->t || imu_.empty() || t > imu_.back_time()) return std::nullopt;
  if (t == from->t) return from;
  const auto samples = imu_.slice(from->t, t, options_.imu.margin_samples);
  if (samples.size() < 2) return std::nullopt;
  const Preintegration motion(samples, from->t, t, from->bias, rig_.imu, options_.imu);
  return predict(*from, motion.at(t), motion.bias(), smoother().projection().gravity);
}

Diagnostics Odometry::diagnostics() const {
  Diagnostics all = diagnostics_;
  const SegmenterCounts counts = segmenter_->counts();
  if (counts.flicker > 0)
    all.warn("flicker",
             fmt::format("the light flickers at {:.0f} Hz: {:.0f} % of the events were left out",
                         flicker_filter_->frequency_hz(),
                         100 * static_cast<double>(counts.flicker) / static_cast<double>(counts.events)),
             counts.flicker);
  constexpr std::int64_t kEnough = 20000;  // events
  constexpr double kFew = 0.1;             // share of them on lines
  const double on_lines = static_cast<double>(counts.in_segments) /
                          static_cast<double>(std::max<std::int64_t>(1, counts.events - counts.flicker));
  if (const auto stages = segmenter_->stages(); stages && counts.events > kEnough && on_lines < kFew)
    all.warn("few_lines",
             fmt::format("{:.0f} % of the events are on lines: {}", 100 * on_lines, stages->explanation()));
  all.merge(estimator_.diagnostics());
  all.merge(imu_.diagnostics());
  return all;
}

}  // namespace idol
