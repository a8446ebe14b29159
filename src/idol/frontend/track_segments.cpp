// Segments of a window from tracks: events are labelled batch by batch, then each track's events get a fitted
// line.
#include <algorithm>
#include <map>

#include "idol/frontend/segments.hpp"

namespace idol {
namespace {

constexpr std::size_t kFitEvents = 400;  // of a segment, spread evenly: more do not sharpen a fit

}  // namespace

// Batches tile the window from its begin on; each ends early when it is full.
void Segmenter::label(const EventWindow& window, std::vector<LineId>& ids) {
  const auto& events = window.events;
  ids.assign(events.size(), kNoLine);
  const std::size_t kept = std::min(window.overlap, previous_ids_.size());
  std::copy(previous_ids_.end() - static_cast<std::ptrdiff_t>(kept), previous_ids_.end(),
            ids.begin() + static_cast<std::ptrdiff_t>(window.overlap - kept));
  const Time step = from_seconds(options_.track.batch_s);
  const auto most = static_cast<std::size_t>(options_.track.batch_events);
  for (std::size_t i = window.overlap; i < events.size();) {
    const Time end = window.begin + ((events[i].t - window.begin) / step + 1) * step;
    std::size_t j = i;
    while (j < events.size() && events[j].t < end && j - i < most) ++j;
    tracker_->process({&events[i], j - i}, &ids[i]);
    i = j;
  }
}

SegmentedWindow Segmenter::process_tracks(const EventWindow& window) {
  SegmentedWindow out;
  label(window, out.ids);
  std::map<LineId, std::vector<std::uint32_t>> members;
  for (std::uint32_t i = 0; i < out.ids.size(); ++i) {
    LineId& id = out.ids[i];
    if (id == kNoLine) continue;
    id = tracker_->final_id(id);
    members[id].push_back(i);
  }
  previous_ids_ = out.ids;
  out.c_s_per_px = tracker_->c_s_per_px();
  out.speed_px_s = 1 / out.c_s_per_px;
  for (auto& [id, events] : members) {
    std::optional<MovingLine> line;
    if (tracker_->confirmed(id) && std::ssize(events) >= options_.min_events)
      line = fit_track(window, events, id);
    if (line) {
      out.segments.push_back({id, std::move(events), *line});
    } else {
      for (const std::uint32_t i : events) out.ids[i] = kNoLine;
    }
  }
  return out;
}

std::optional<MovingLine> Segmenter::fit_track(const EventWindow& window,
                                               std::span<const std::uint32_t> events, LineId id) const {
  std::vector<TimedPixel> points;
  const std::size_t n = std::min(events.size(), kFitEvents);
  for (std::size_t k = 0; k < n; ++k) {
    const Event& e = window.events[events[(2 * k + 1) * events.size() / (2 * n)]];
    const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
    points.emplace_back(px.x(), px.y(), seconds_between(window.begin, e.t));
  }
  auto line = fit_moving_line(points, tracker_->normal(id), options_.gate_px);
  if (!line || line->length_px() < options_.track.min_length_px || line->rms_px > options_.max_rms_px ||
      line->bow_px > options_.max_bow_px)
    return std::nullopt;
  return line;
}

}  // namespace idol
