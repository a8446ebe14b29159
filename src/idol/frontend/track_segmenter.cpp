#include "idol/frontend/track_segmenter.hpp"

#include <algorithm>
#include <limits>

#include "idol/frontend/waviness.hpp"

namespace idol {
namespace {

constexpr std::size_t kFitEvents = 120;  // of a segment, spread evenly: more do not sharpen a fit

// Of the last rate at or before the time.
Vec3 rate_at(std::span<const CameraRate> rates, Time t) {
  const auto after = std::upper_bound(rates.begin(), rates.end(), t,
                                      [](Time time, const CameraRate& rate) { return time < rate.t; });
  return after == rates.begin() ? after->omega : std::prev(after)->omega;
}

}  // namespace

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
    const bool confirmed = tracker_.confirmed(s.id);
    std::optional<MovingLine> line;
    if (std::ssize(s.events) >= options_.min_events) line = fit_track(window, s.events, s.id);
    if (line) {
      s.line = *line;
      s.clear = confirmed && waviness(window, s.events, s.line, *undistort_) <= options_.max_wave_px;
    }
    if (!line || !s.clear)
      for (const std::uint32_t i : s.events) out.ids[i] = kNoLine;
    if (line && !confirmed) out.tentative.push_back(std::move(s));
    return !line || !confirmed;
  });
  counts_.add(window, out.ids);
  tracker_.forget_before(window.begin);
  return out;
}

SegmenterCounts TrackSegmenter::counts() const {
  SegmenterCounts out = counts_;
  out.hot = tracker_.hot();
  out.unsupported = tracker_.unsupported();
  out.thinned = tracker_.thinned();
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

std::optional<MovingLine> TrackSegmenter::fit_track(const EventWindow& window,
                                                    std::span<const std::uint32_t> events, LineId id) {
  points_.clear();
  const std::size_t n = std::min(events.size(), kFitEvents);
  for (std::size_t k = 0; k < n; ++k) {
    const Event& e = window.events[events[(2 * k + 1) * events.size() / (2 * n)]];
    const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
    points_.emplace_back(px.x(), px.y(), seconds_between(window.begin, e.t));
  }
  auto line = fit_moving_line(points_, tracker_.normal(id), options_.gate_px);
  if (!line || line->length_px() < options_.track.min_length_px || line->rms_px > options_.max_rms_px ||
      line->bow_px > options_.max_bow_px)
    return std::nullopt;
  return line;
}

}  // namespace idol
