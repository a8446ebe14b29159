#include "idol/frontend/track_segmenter.hpp"

#include <algorithm>
#include <limits>

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
    std::optional<MovingLine> line;
    if (tracker_.confirmed(s.id) && std::ssize(s.events) >= options_.min_events)
      line = fit_track(window, s.events, s.id);
    if (line) {
      s.line = *line;
      return false;
    }
    for (const std::uint32_t i : s.events) out.ids[i] = kNoLine;
    return true;
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

// One segment for each track that has events, in the order of ids; merged tracks are one.
void TrackSegmenter::sort_by_track(SegmentedWindow& out) const {
  LineId least = std::numeric_limits<LineId>::max(), most = kNoLine;
  for (const LineId id : out.ids) {
    if (id == kNoLine) continue;
    least = std::min(least, id);
    most = std::max(most, id);
  }
  if (most == kNoLine) return;
  std::vector<LineId> goes_on(static_cast<std::size_t>(most - least + 1), kNoLine);
  std::vector<std::uint32_t> counts(goes_on.size());
  for (LineId& id : out.ids) {
    if (id == kNoLine) continue;
    LineId& known = goes_on[static_cast<std::size_t>(id - least)];
    if (known == kNoLine) known = tracker_.final_id(id);
    id = known;
    // A track may go on as one that has no events of its own here.
    if (id < least) {
      const auto more = static_cast<std::size_t>(least - id);
      goes_on.insert(goes_on.begin(), more, kNoLine);
      counts.insert(counts.begin(), more, 0);
      least = id;
    }
    ++counts[static_cast<std::size_t>(id - least)];
  }
  std::vector<std::uint32_t> slots(counts.size());
  for (std::size_t k = 0; k < counts.size(); ++k) {
    if (counts[k] == 0) continue;
    slots[k] = static_cast<std::uint32_t>(out.segments.size());
    out.segments.push_back({least + static_cast<LineId>(k), {}, {}});
    out.segments.back().events.reserve(counts[k]);
  }
  for (std::uint32_t i = 0; i < out.ids.size(); ++i)
    if (out.ids[i] != kNoLine)
      out.segments[slots[static_cast<std::size_t>(out.ids[i] - least)]].events.push_back(i);
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
