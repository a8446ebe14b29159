#include "idol/image/tracker/track_segmenter.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "idol/base/wide.hpp"
#include "idol/image/tracker/waviness.hpp"

namespace idol {
namespace {

constexpr std::ptrdiff_t kFewEvents = 6;  // of a line that is followed, in a window
constexpr double kWaveMemory = 0.7;       // of a segment's waviness from window to window
constexpr std::size_t kFitEvents = 120;   // of a segment, spread evenly: more do not sharpen a fit

// For each event from `first` to `end`: 1 if it is nearer to the line than `gate` and beside it, else 0.
IDOL_WIDE void mark_near(const WindowColumns& events, std::size_t first, std::size_t end,
                         const MovingLine& line, float gate, std::uint8_t* near) {
  const auto dx = static_cast<float>(line.direction.x()), dy = static_cast<float>(line.direction.y());
  const auto ox = static_cast<float>(line.origin.x()), oy = static_cast<float>(line.origin.y());
  const auto middle = static_cast<float>(line.time);
  const auto c0 = static_cast<float>(line.c[0]), c1 = static_cast<float>(line.c[1]);
  const auto c2 = static_cast<float>(line.c[2]), c3 = static_cast<float>(line.c[3]);
  const auto lo = static_cast<float>(line.u_min) - 1, hi = static_cast<float>(line.u_max) + 1;
  // Pointers of its own, which what is written cannot change, let the compiler use wide registers.
  const float *const xs = events.x.data(), *const ys = events.y.data(), *const ts = events.t.data();
  for (std::size_t i = first; i < end; ++i) {
    const float x = xs[i] - ox, y = ys[i] - oy, t = ts[i] - middle;
    const float u = dx * x + dy * y;
    const float r = dx * y - dy * x - (c0 + c1 * u + (c2 + c3 * u) * t);
    near[i] = (r < gate) & (r > -gate) & (u > lo) & (u < hi) ? 1 : 0;
  }
}

// Of the last rate at or before the time.
Vec3 rate_at(std::span<const CameraRate> rates, Time t) {
  const auto after = std::upper_bound(rates.begin(), rates.end(), t,
                                      [](Time time, const CameraRate& rate) { return time < rate.t; });
  return after == rates.begin() ? after->omega : std::prev(after)->omega;
}

}  // namespace

void WindowColumns::fill(const EventWindow& window, const UndistortMap& undistort) {
  if (filled && x.size() == window.events.size()) return;
  const std::size_t n = window.events.size();
  x.resize(n), y.resize(n), t.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Event& e = window.events[i];
    const Eigen::Vector2f& px = undistort(e.x, e.y);
    x[i] = px.x(), y[i] = px.y(), t[i] = static_cast<float>(e.t - window.begin) * 1e-9F;
  }
  filled = true;
}

// Batches that later events could still join wait while the window is open.
void TrackSegmenter::label(const EventWindow& window, std::span<const CameraRate> rates, bool open) {
  const auto& events = window.events;
  if (at_hand_ != window.begin) {
    at_hand_ = window.begin;
    ids_.assign(window.overlap, kNoLine);
    const std::size_t kept = std::min(window.overlap, previous_ids_.size());
    std::copy(previous_ids_.end() - static_cast<std::ptrdiff_t>(kept), previous_ids_.end(),
              ids_.end() - static_cast<std::ptrdiff_t>(kept));
    labelled_ = window.overlap;
  }
  ids_.resize(events.size(), kNoLine);
  while (labelled_ < events.size()) {
    const std::size_t i = labelled_;
    const std::size_t n = tracker_.batch_length(std::span(events).subspan(i), window.begin);
    if (open && i + n == events.size()) return;
    const Time middle = events[i + n / 2].t;
    if (open && (rates.empty() || rates.back().t <= middle)) return;
    if (!rates.empty()) tracker_.turn(events[i].t, rate_at(rates, middle));
    tracker_.process({&events[i], n}, &ids_[i]);
    labelled_ += n;
  }
}

void TrackSegmenter::prepare(const EventWindow& window, std::span<const CameraRate> rates) {
  label(window, rates, true);
}

SegmentedWindow TrackSegmenter::process(const EventWindow& window, std::span<const CameraRate> rates) {
  SegmentedWindow out;
  label(window, rates, false);
  at_hand_.reset();
  out.ids = std::move(ids_);
  sort_by_track(out);
  previous_ids_ = out.ids;
  out.c_s_per_px = tracker_.c_s_per_px();
  out.speed_px_s = 1 / out.c_s_per_px;
  std::erase_if(out.segments, [&](Segment& s) {
    const bool validated = tracker_.validated(s.id);
    std::optional<MovingLine> line;
    if (std::ssize(s.events) >= options_.min_events)
      line = fit_track(window, s.events, s.id);
    else if (std::ssize(s.events) >= kFewEvents)
      line = track_line(window, s.id);
    if (line) {
      s.line = *line;
      s.sigma_px = tracker_.sigma_px(s.id);
      const Waviness now = waviness(window, s.events, s.line, 2 * s.sigma_px, *undistort_);
      Waviness& all = waviness_[s.id];
      all.squares = kWaveMemory * all.squares + now.squares;
      all.events = kWaveMemory * all.events + now.events;
      s.waviness_px = all.rms_px();
      s.straight = s.waviness_px <= options_.max_wave_px + options_.wave_share * s.sigma_px;
    }
    ++(!line        ? std::ssize(s.events) < options_.min_events ? stages_.few_events : stages_.not_straight
       : !validated ? stages_.candidates
       : s.straight ? stages_.reported
                    : stages_.wavy);
    if (!line || !validated || !s.straight)
      for (const std::uint32_t i : s.events) out.ids[i] = kNoLine;
    if (line && !validated) out.candidates.push_back(std::move(s));
    return !line || !validated;
  });
  columns_.filled = false;
  for (Segment& s : out.segments) label_back(window, s, s.straight, out.ids);
  for (Segment& s : out.candidates) label_back(window, s, false, out.ids);
  for (auto [was, is] : tracker_.take_validated()) out.validated.emplace_back(was, tracker_.final_id(is));
  counts_.add(window, out.ids);
  for (const LineTrack& track : tracker_.tracks()) {
    ++followed_;
    stages_.sigma_px += (track.sigma - stages_.sigma_px) / followed_;
    stages_.speed_px_s += (std::abs(track.x[2]) - stages_.speed_px_s) / followed_;
  }
  tracker_.forget_before(window.begin);
  std::erase_if(waviness_, [&](const auto& entry) { return !tracker_.knows(entry.first); });
  return out;
}

SegmenterCounts TrackSegmenter::counts() const {
  SegmenterCounts out = counts_;
  out.hot = tracker_.hot();
  out.unsupported = tracker_.unsupported();
  out.thinned = tracker_.thinned();
  return out;
}

std::optional<StageCounts> TrackSegmenter::stages() const {
  StageCounts out = stages_;
  out.tracker = tracker_.counts();
  return out;
}

// One segment for each track that has events, in the order of ids; merged tracks are one. Every other event
// may have no line: without a branch on it this takes a third of the time.
void TrackSegmenter::sort_by_track(SegmentedWindow& out) const {
  static_assert(kNoLine == -1);
  LineId least = std::numeric_limits<LineId>::max(), most = kNoLine;
  for (const LineId id : out.ids) {
    least = std::min(least, id == kNoLine ? least : id);
    most = std::max(most, id);
  }
  if (most == kNoLine) return;
  // By id from `least` on, after a first place for events without a line.
  const auto place = [&](LineId id) { return static_cast<std::size_t>(std::max<LineId>(id - least + 1, 0)); };
  std::vector<std::uint32_t> counts(place(most) + 1);
  for (const LineId id : out.ids) ++counts[place(id)];
  std::vector<LineId> final_ids(counts.size(), kNoLine);
  std::vector<std::pair<LineId, std::size_t>> order;  // final id, place
  for (std::size_t k = 1; k < counts.size(); ++k) {
    if (counts[k] == 0) continue;
    final_ids[k] = tracker_.final_id(least + static_cast<LineId>(k) - 1);
    order.emplace_back(final_ids[k], k);
  }
  std::sort(order.begin(), order.end());
  // Events go where their track's segment is.
  std::vector<std::uint32_t> nowhere(counts[0]);
  std::vector<std::size_t> segment_of(counts.size());
  for (const auto& [id, k] : order) {
    if (out.segments.empty() || out.segments.back().id != id) out.segments.push_back({id, {}, {}});
    auto& events = out.segments.back().events;
    events.resize(events.size() + counts[k]);
    segment_of[k] = out.segments.size();
  }
  std::vector<std::uint32_t*> next{nowhere.data()};
  for (Segment& segment : out.segments) next.push_back(segment.events.data());
  for (std::uint32_t i = 0; i < out.ids.size(); ++i) {
    const std::size_t k = place(out.ids[i]);
    out.ids[i] = final_ids[k];
    *next[segment_of[k]]++ = i;
  }
}

// Events from before the track's birth that lie where its line has come from: the ones that it was found by.
void TrackSegmenter::label_back(const EventWindow& window, Segment& segment, bool labelled,
                                std::vector<LineId>& ids) {
  constexpr double kBack = 4, kLongest = 0.1;  // [px], [s]
  const Time born = tracker_.born(segment.id);
  if (born <= window.begin) return;
  const double speed = std::hypot(segment.line.c[2], 1.0);
  const Time from = std::max(window.begin, born - from_seconds(std::min(kLongest, kBack / speed)));
  const auto at = [&](Time t) {
    return static_cast<std::size_t>(std::lower_bound(window.events.begin(), window.events.end(), t,
                                                     [](const Event& e, Time time) { return e.t < time; }) -
                                    window.events.begin());
  };
  const std::size_t first = at(from), end = at(born);
  if (first >= end) return;
  columns_.fill(window, *undistort_);
  const double gate = std::max(EdgeLimits::kLeastGate, 2.5 * segment.sigma_px);
  near_.resize(columns_.x.size());
  mark_near(columns_, first, end, segment.line.extrapolable(), static_cast<float>(gate), near_.data());
  const float polarity = tracker_.polarity(segment.id);
  std::vector<std::uint32_t> earlier;
  for (std::size_t i = first; i < end; ++i) {
    // Few are: memchr passes the others many at a time.
    const void* const found = std::memchr(&near_[i], 1, end - i);
    if (!found) break;
    i = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - near_.data());
    if (ids[i] != kNoLine || (polarity != 0 && (polarity > 0) != window.events[i].polarity)) continue;
    earlier.push_back(static_cast<std::uint32_t>(i));
    if (labelled) ids[i] = segment.id;
  }
  const auto middle = static_cast<std::ptrdiff_t>(earlier.size());
  segment.events.insert(segment.events.begin(), earlier.begin(), earlier.end());
  std::inplace_merge(segment.events.begin(), segment.events.begin() + middle, segment.events.end());
}

// As it is followed: better than a fit to few events.
std::optional<MovingLine> TrackSegmenter::track_line(const EventWindow& window, LineId id) const {
  const LineTrack* track = tracker_.find(id);
  if (!track || track->hi - track->lo < options_.track.min_length_px) return std::nullopt;
  MovingLine line;
  line.origin = track->centre;
  line.direction = track->dir;
  line.time = seconds_between(window.begin, track->time);
  line.c.head<4>() = track->x;
  line.u_min = track->lo, line.u_max = track->hi;
  line.rms_px = track->sigma;
  return line;
}

std::optional<MovingLine> TrackSegmenter::fit_track(const EventWindow& window,
                                                    std::span<const std::uint32_t> events, LineId id) {
  constexpr std::size_t kFetchedAhead = 16;
  points_.clear();
  const std::size_t n = std::min(events.size(), kFitEvents);
  const double step = static_cast<double>(events.size()) / static_cast<double>(n);
  const auto event = [&](std::size_t k) -> const Event& {
    return window.events[events[static_cast<std::size_t>((static_cast<double>(k) + 0.5) * step)]];
  };
  for (std::size_t k = 0; k < n; ++k) {
    __builtin_prefetch(&event(std::min(k + kFetchedAhead, n - 1)));
    const Event& e = event(k);
    const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
    points_.emplace_back(px.x(), px.y(), seconds_between(window.begin, e.t));
  }
  const double sigma = tracker_.sigma_px(id);
  auto line = fit_moving_line(points_, tracker_.normal(id), std::max(options_.gate_px, 2.5 * sigma));
  if (!line || line->length_px() < options_.track.min_length_px ||
      line->rms_px > std::max(options_.max_rms_px, 1.4 * sigma) ||
      line->bow_px > most_bow_px(options_.max_bow_px, line->length_px(), sigma, static_cast<double>(n)))
    return std::nullopt;
  return line;
}

}  // namespace idol
