#include "idol/odometry/window_estimator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "idol/backend/fixed_lag.hpp"
#include "idol/backend/line_moments.hpp"
#include "idol/backend/smoother.hpp"
#include "idol/base/stopwatch.hpp"

namespace idol {
namespace {

std::unique_ptr<Backend> make_backend(const Rig& rig, const BackendOptions& options) {
  if (options.method == BackendMethod::kFixedLag) return std::make_unique<FixedLag>(rig, options);
  return std::make_unique<Smoother>(rig, options);
}

}  // namespace

WindowEstimator::WindowEstimator(const Rig& rig, const Options& options, const UndistortMap& undistort)
    : noise_(rig.imu),
      options_(options),
      undistort_(undistort),
      backend_(make_backend(rig, options.backend)),
      motion_(rig.camera.width, rig.camera.height) {}

void WindowEstimator::start(const ImuInit& init, Time begin) {
  NavState first;
  first.t = begin;
  first.T_w_i.q = init.q_w_i;
  first.bias = init.bias;
  backend_->start(first, init.still);
  rest_.begin(init.still, first.t + from_seconds(options_.start.duration_s));
}

WindowEstimator::Outcome WindowEstimator::estimate(const Segmented& segmented) {
  const EventWindow& window = segmented.window;
  const SegmentedWindow& segments = segmented.segments;
  Stopwatch watch;
  Outcome out;
  const NavState& from = backend_->latest();
  WindowMeasurement measurement;
  measurement.imu = std::make_shared<Preintegration>(segmented.samples, window.begin, window.end, from.bias,
                                                     noise_, options_.imu);
  check_quality(measurement.imu->quality(), window);
  std::vector<ImuSample> inside;
  std::copy_if(segmented.samples.begin(), segmented.samples.end(), std::back_inserter(inside),
               [&](const ImuSample& s) { return s.t >= window.begin && s.t <= window.end; });
  const std::int64_t noise = segmented.counts.hot + segmented.counts.unsupported;
  motion_.add(window, segments);
  out.still = rest_.update(window, motion_.moves(), noise - std::exchange(noise_events_, noise), inside,
                           from.bias, options_.backend.gravity) &&
              options_.backend.use_rest;
  measurement.still = out.still;
  measurement.lines = observe(window, segments, *measurement.imu);
  if (options_.backend.method == BackendMethod::kFixedLag)
    for (int k = 0, n = bin_count(window); k < n; ++k)
      measurement.bin_motions.push_back(
          measurement.imu->at(window.begin + (2 * k + 1) * (window.end - window.begin) / (2 * n)));
  for (const auto& line : measurement.lines) ++track_windows_[line.id];
  out.integrate_s = watch.lap();
  backend_->add(std::move(measurement));
  out.stats = backend_->solve();
  out.solve_s = watch.lap();
  return out;
}

void WindowEstimator::check_quality(const SampleQuality& quality, const EventWindow& window) {
  const double begin_s = static_cast<double>(window.begin) / kNsPerS;
  if (quality.saturated > 0)
    diagnostics_.warn("imu_saturated",
                      fmt::format("IMU readings at the sensor's range in the window from {:.3f} s on: "
                                  "their noise is inflated, accuracy suffers there",
                                  begin_s),
                      quality.saturated);
  constexpr double kNoisy = 2;
  if (quality.noise_ratio > kNoisy)
    diagnostics_.warn(
        "imu_noise",
        fmt::format("the IMU's readings in the window from {:.3f} s on are {:.1f} times as noisy as "
                    "the rig says: it is trusted by what is seen",
                    begin_s, quality.noise_ratio));
}

// The longest tracks first, then the longest segments; of each, events spread evenly over its time.
std::vector<LineObservation> WindowEstimator::observe(const EventWindow& window,
                                                      const SegmentedWindow& segments,
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
std::vector<EventMeasurement> WindowEstimator::choose_events(const EventWindow& window,
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

int WindowEstimator::bin_count(const EventWindow& window) const {
  return std::max(
      1, static_cast<int>(std::lround(seconds_between(window.begin, window.end) / options_.backend.bin_s)));
}

// All events in bins of equal time, each moved across the line to its bin's middle as the segment moves. Bins
// with few events, as slow lines have them, are joined until there are enough.
std::vector<LineBin> WindowEstimator::compress_events(const EventWindow& window,
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

}  // namespace idol
