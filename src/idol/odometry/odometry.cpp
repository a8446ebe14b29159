#include "idol/odometry/odometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "idol/backend/fixed_lag.hpp"
#include "idol/backend/line_moments.hpp"
#include "idol/backend/smoother.hpp"

namespace idol {
namespace {

class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(last_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

constexpr std::size_t kMostWaiting = 4;  // windows between the front-end and the back-end
constexpr double kImuTail = 0.05;        // [s]: events after the last IMU sample that nobody will miss
constexpr double kShortestWindow =
    0.005;  // [s]: what is left at the end of the data and shorter is not estimated

std::unique_ptr<Backend> make_backend(const Rig& rig, const BackendOptions& options) {
  if (options.method == BackendMethod::kFixedLag) return std::make_unique<FixedLag>(rig, options);
  return std::make_unique<Smoother>(rig, options);
}

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
      smoother_(make_backend(rig, options.backend)),
      motion_(rig.camera.width, rig.camera.height) {
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
  start_when_known(true);
  wait();
  if (!started_ && !start_failure_.empty()) throw DataError(start_failure_);
  if (started()) smoother_->finish();
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
    } else if (window.begin < imu_.front_time() && !started_) {
      diagnostics_.warn("events_before_imu",
                        fmt::format("the IMU starts at {:.3f} s: earlier events are not used",
                                    static_cast<double>(imu_.front_time()) / kNsPerS));
      waiting_.reset();
      continue;
    }
    if (!imu_.covers(window.end, last ? 1 : options_.imu.margin_samples)) {
      if (!last) return;
      if (!imu_.empty() && seconds_between(window.begin, imu_.back_time()) > kShortestWindow) {
        shorten(*waiting_, imu_.back_time());
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
  const Time until = std::min(window.events.back().t, imu_.back_time());
  if (until <= window.begin || until < prepared_ + kEvery) return;
  prepared_ = until;
  Stopwatch watch;
  segmenter_->prepare(window,
                      camera_rates(imu_.slice(window.begin, until, options_.imu.margin_samples), rig_));
  prepare_s_ += watch.lap();
}

// A window that the IMU will never reach.
void Odometry::drop_waiting() {
  if (imu_.empty()) {
    diagnostics_.warn("no_imu", "there is no IMU data: nothing is estimated");
  } else if (seconds_between(imu_.back_time(), waiting_->end) > kImuTail) {
    diagnostics_.warn("imu_ends_early", fmt::format("the IMU ends at {:.3f} s, before the events: nothing is "
                                                    "estimated after it",
                                                    static_cast<double>(imu_.back_time()) / kNsPerS));
  }
  waiting_.reset();
}

// The start is found from the first windows together; after a violent motion, from later ones.
void Odometry::start_when_known(bool last) {
  while (!started_ && !held_.empty()) {
    const Time begin = held_.front()->window.begin, until = begin + from_seconds(options_.start.duration_s);
    if (held_.back()->window.end < until && !last) return;
    const auto samples = imu_.slice(begin, until, 0);
    ImuInitOptions options = options_.start;
    if (!options_.backend.use_rest || image_moves()) options.still_gyro_std = 0;  // whatever the IMU says
    try {
      start(initialise_from_imu(samples, options_.backend.gravity, options));
    } catch (const ViolentStart& e) {
      if (start_failure_.empty()) start_failure_ = e.what();
      held_.pop_front();
      if (!held_.empty()) imu_.drop_before(held_.front()->window.begin, 2 * options_.imu.margin_samples);
    }
  }
}

// Steadily, so that the IMU alone would think it at rest. Something that passes before a camera at rest does
// not fill the image.
bool Odometry::image_moves() const {
  constexpr double kSpread = 0.4;  // of width and height
  ImageMotion motion(rig_.camera.width, rig_.camera.height);
  // What is noise and what is a line is known after a while.
  const Time known = held_.front()->window.begin + from_seconds(0.5 * options_.start.duration_s);
  return std::any_of(held_.begin(), held_.end(), [&](const auto& segmented) {
    motion.add(segmented->window, segmented->segments);
    return segmented->window.end > known && motion.moves(kSpread);
  });
}

void Odometry::start(const ImuInit& init) {
  NavState first;
  first.t = held_.front()->window.begin;
  first.T_w_i.q = init.q_w_i;
  first.bias = init.bias;
  smoother_->start(first, init.still);
  started_ = true;
  rest_.begin(init.still, first.t + from_seconds(options_.start.duration_s));
  if (!start_failure_.empty())
    diagnostics_.warn("late_start", fmt::format("nothing is estimated before {:.3f} s: {}",
                                                static_cast<double>(first.t) / kNsPerS, start_failure_));
  if (!init.still)
    diagnostics_.warn("moving_start",
                      fmt::format("the recording does not start at rest (rate spread {:.3f} rad/s, force "
                                  "spread {:.2f} m/s^2): the first seconds may be poor",
                                  init.gyro_std, init.accel_std));
  for (auto& segmented : held_) hand_over(std::move(segmented));
  held_.clear();
}

// What the front-end makes of a window depends on nothing that the back-end finds: both can work at a time.
void Odometry::segment(EventWindow&& window) {
  Stopwatch watch;
  auto done = std::make_shared<Segmented>();
  done->samples = imu_.slice(window.begin, window.end, options_.imu.margin_samples);
  done->segments = segmenter_->process(window, camera_rates(done->samples, rig_));
  done->window = std::move(window);
  done->counts = segmenter_->counts();
  done->segment_s = watch.lap() + std::exchange(prepare_s_, 0);
  if (!started_) {
    held_.push_back(std::move(done));
    start_when_known(false);
    return;
  }
  // What carries the newest estimate on stays.
  if (const auto known = newest())
    imu_.drop_before(std::min(done->window.end, known->t), 2 * options_.imu.margin_samples);
  hand_over(std::move(done));
}

void Odometry::hand_over(std::shared_ptr<const Segmented> segmented) {
  if (background_)
    background_->run([this, segmented = std::move(segmented)] { estimate(*segmented); });
  else
    estimate_here(*segmented);
}

// As in the second thread: what throws leaves things half done, and is the last.
void Odometry::estimate_here(const Segmented& segmented) {
  if (std::exchange(failed_, true))
    throw UsageError("the estimation has ended with an error: make another Odometry");
  estimate(segmented);
  failed_ = false;
}

void Odometry::estimate(const Segmented& segmented) {
  const EventWindow& window = segmented.window;
  const SegmentedWindow& segments = segmented.segments;
  Stopwatch watch;
  const NavState& from = smoother_->latest();
  WindowMeasurement measurement;
  measurement.imu = std::make_shared<Preintegration>(segmented.samples, window.begin, window.end, from.bias,
                                                     rig_.imu, options_.imu);
  if (const int saturated = measurement.imu->quality().saturated; saturated > 0)
    backend_diagnostics_.warn(
        "imu_saturated",
        fmt::format("IMU readings at the sensor's range in the window from {:.3f} s on: "
                    "their noise is inflated, accuracy suffers there",
                    static_cast<double>(window.begin) / kNsPerS),
        saturated);
  constexpr double kNoisy = 2;
  if (const double ratio = measurement.imu->quality().noise_ratio; ratio > kNoisy)
    backend_diagnostics_.warn(
        "imu_noise",
        fmt::format("the IMU's readings in the window from {:.3f} s on are {:.1f} times as noisy as "
                    "the rig says: it is trusted by what is seen",
                    static_cast<double>(window.begin) / kNsPerS, ratio));
  std::vector<ImuSample> inside;
  std::copy_if(segmented.samples.begin(), segmented.samples.end(), std::back_inserter(inside),
               [&](const ImuSample& s) { return s.t >= window.begin && s.t <= window.end; });
  const std::int64_t noise = segmented.counts.hot + segmented.counts.unsupported;
  motion_.add(window, segments);
  measurement.still = rest_.update(window, motion_.moves(), noise - std::exchange(noise_events_, noise),
                                   inside, from.bias, options_.backend.gravity) &&
                      options_.backend.use_rest;
  measurement.lines = observe(window, segments, *measurement.imu);
  if (options_.backend.method == BackendMethod::kFixedLag)
    for (int k = 0, n = bin_count(window); k < n; ++k)
      measurement.bin_motions.push_back(
          measurement.imu->at(window.begin + (2 * k + 1) * (window.end - window.begin) / (2 * n)));
  for (const auto& line : measurement.lines) ++track_windows_[line.id];
  const double integrate_s = watch.lap();
  smoother_->add(std::move(measurement));
  const SolveStats stats = smoother_->solve();
  {
    const std::lock_guard lock(newest_mutex_);
    newest_ = smoother_->latest();
  }
  if (listener_)
    listener_({smoother_->latest(), window, segments, *smoother_, stats, segmented.segment_s, integrate_s,
               watch.lap(), segmented.counts});
}

std::optional<NavState> Odometry::newest() const {
  const std::lock_guard lock(newest_mutex_);
  return newest_;
}

// The longest tracks first, then the longest segments; of each, events spread evenly over its time.
std::vector<LineObservation> Odometry::observe(const EventWindow& window, const SegmentedWindow& segments,
                                               const Preintegration& imu) const {
  const auto age = [&](const Segment& s) {
    const auto it = track_windows_.find(s.id);
    return it == track_windows_.end() ? 0 : it->second;
  };
  const auto most = static_cast<std::size_t>(options_.backend.max_lines_per_window);
  std::vector<const Segment*> chosen;
  for (const auto& segment : segments.segments) chosen.push_back(&segment);
  std::stable_sort(chosen.begin(), chosen.end(), [&](const Segment* a, const Segment* b) {
    return std::pair(age(*a), a->line.length_px()) > std::pair(age(*b), b->line.length_px());
  });
  chosen.resize(std::min(chosen.size(), most));
  const std::size_t sure = chosen.size();
  if (options_.backend.method == BackendMethod::kFixedLag)
    for (const auto& segment : segments.candidates)
      if (chosen.size() < most) chosen.push_back(&segment);

  std::vector<LineObservation> out;
  const auto measure = [&](const Vec2& px, Time t) { return EventMeasurement{px, imu.at(t)}; };
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    const Segment* const segment = chosen[k];
    // The repeated events belong to the window before; a segment with hardly any of its own is not seen in
    // this one.
    const auto own = std::lower_bound(segment->events.begin(), segment->events.end(),
                                      static_cast<std::uint32_t>(window.overlap));
    const auto count = static_cast<std::size_t>(segment->events.end() - own);
    if (count < 2) continue;
    LineObservation observation;
    observation.id = segment->id;
    observation.candidate = k >= sure;
    observation.event_count = static_cast<std::int64_t>(count);
    const std::span own_events(own, segment->events.end());
    if (options_.backend.method == BackendMethod::kFixedLag)
      observation.bins = compress_events(window, own_events, *segment);
    else
      observation.events = choose_events(window, own_events, imu);
    const Time middle = window.events[*(own + static_cast<std::ptrdiff_t>(count / 2))].t;
    const double t = seconds_between(window.begin, middle);
    observation.end_a = measure(segment->line.point(segment->line.u_min, t), middle);
    observation.end_b = measure(segment->line.point(segment->line.u_max, t), middle);
    out.push_back(std::move(observation));
  }
  return out;
}

// Spread evenly over the segment's time.
std::vector<EventMeasurement> Odometry::choose_events(const EventWindow& window,
                                                      std::span<const std::uint32_t> events,
                                                      const Preintegration& imu) const {
  std::vector<EventMeasurement> out;
  const std::size_t count = events.size();
  const auto wanted = std::min(count, static_cast<std::size_t>(options_.backend.max_events_per_observation));
  for (std::size_t k = 0; k < wanted; ++k) {
    const Event& e = window.events[events[(2 * k + 1) * count / (2 * wanted)]];
    out.push_back({undistort_(e.x, e.y).cast<double>(), imu.at(e.t)});
  }
  return out;
}

int Odometry::bin_count(const EventWindow& window) const {
  return std::max(
      1, static_cast<int>(std::lround(seconds_between(window.begin, window.end) / options_.backend.bin_s)));
}

// All events in bins of equal time, each moved across the line to its bin's middle as the segment moves. Bins
// with few events, as slow lines have them, are joined until there are enough.
std::vector<LineBin> Odometry::compress_events(const EventWindow& window,
                                               std::span<const std::uint32_t> events,
                                               const Segment& segment) const {
  const double duration = seconds_between(window.begin, window.end);
  const int bins = bin_count(window);
  const MovingLine& line = segment.line;
  constexpr double kGateSigmas = 1.6;  // what is farther is the tail of late events, and noise
  const double gate = std::max(options_.backend.bin_gate_px, kGateSigmas * segment.sigma_px);
  std::vector<LineBin> out;
  const auto bin_of = [&](std::uint32_t i) {
    const double share = seconds_between(window.begin, window.events[i].t) / duration;
    return std::clamp(static_cast<int>(share * bins), 0, bins - 1);
  };
  std::vector<Vec2> points;
  std::vector<double> times;
  int first = 0;  // bin of the points
  const auto finish = [&](int last) {
    if (std::ssize(points) < options_.backend.min_bin_events) return false;
    const int slot = (first + last) / 2;
    const double middle = (slot + 0.5) * duration / bins;
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double u = line.along({points[k].x(), points[k].y(), times[k]});
      points[k] += line.point(u, middle) - line.point(u, times[k]);
    }
    const LineMoments moments = compress(points);
    const auto heading = [&](const Vec2& px) {
      return line.heading(line.along({px.x(), px.y(), middle}), middle);
    };
    out.push_back({moments.a(), moments.b(), heading(moments.a()), heading(moments.b()), slot, moments.count,
                   segment.sigma_px});
    return true;
  };
  std::size_t next = 0;
  for (int bin = 0; bin < bins; ++bin) {
    if (points.empty()) first = bin;
    for (; next < events.size() && bin_of(events[next]) <= bin; ++next) {
      const Event& e = window.events[events[next]];
      const Vec2 px = undistort_(e.x, e.y).cast<double>();
      const double t = seconds_between(window.begin, e.t);
      if (std::abs(line.distance({px.x(), px.y(), t})) > gate) continue;
      points.push_back(px);
      times.push_back(t);
    }
    if (finish(bin)) points.clear(), times.clear();
  }
  return out;
}

std::optional<NavState> Odometry::predict_at(Time t) const {
  const auto from = newest();
  if (!from || t < from->t || imu_.empty() || t > imu_.back_time()) return std::nullopt;
  if (t == from->t) return from;
  const auto samples = imu_.slice(from->t, t, options_.imu.margin_samples);
  if (samples.size() < 2) return std::nullopt;
  const Preintegration motion(samples, from->t, t, from->bias, rig_.imu, options_.imu);
  return predict(*from, motion.at(t), motion.bias(), smoother_->projection().gravity);
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
  all.merge(backend_diagnostics_);
  all.merge(imu_.diagnostics());
  return all;
}

}  // namespace idol
