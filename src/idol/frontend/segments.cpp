#include "idol/frontend/segments.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "idol/frontend/cluster_segmenter.hpp"
#include "idol/image/tracker/track_segmenter.hpp"

namespace idol {

void SegmenterCounts::add(const EventWindow& window, std::span<const LineId> ids) {
  const auto fresh = ids.subspan(window.overlap);
  const auto left_out = static_cast<std::int64_t>(window.flicker);
  flicker += left_out;
  events += std::ssize(fresh) + left_out;
  in_segments += std::count_if(fresh.begin(), fresh.end(), [](LineId id) { return id != kNoLine; });
}

std::string StageCounts::explanation() const {
  const DetectorCounts& d = tracker.detector;
  const auto ended = [&](EndReason reason) { return tracker.ended[static_cast<std::size_t>(reason)]; };
  const std::array<std::pair<std::int64_t, std::string_view>, 10> refused{{
      {d.few, "too few events lie on one line"},
      {d.wide, "edges are too wide"},
      {d.texture + ended(EndReason::kBeside), "events lie to both sides of the lines, as in texture"},
      {d.bent + ended(EndReason::kBent), "edges are curved"},
      {d.brief + ended(EndReason::kBrief), "edges are too short"},
      {ended(EndReason::kSparse) + ended(EndReason::kQuiet), "edges send too few events"},
      {ended(EndReason::kWide) + ended(EndReason::kDouble), "events fill the place evenly, without an edge"},
      {ended(EndReason::kNoise), "lines do not stand out of the noise"},
      {ended(EndReason::kUneven), "lines have gaps"},
      {wavy + not_straight, "edges are not straight"},
  }};
  const auto most = std::max_element(refused.begin(), refused.end(),
                                     [](const auto& a, const auto& b) { return a.first < b.first; });
  std::string out = fmt::format("most candidates were refused since {} ({} of {} fits and {} tracks)",
                                most->second, most->first, d.fits, tracker.born);
  if (tracker.born > 0)
    out += fmt::format("; edges are {:.1f} px wide and move at {:.0f} px/s", 4 * sigma_px, speed_px_s);
  return out;
}

std::span<const CameraRate> rates_over(std::span<const CameraRate> rates, const EventWindow& window) {
  const auto before = [](const CameraRate& rate, Time t) { return rate.t < t; };
  return {std::lower_bound(rates.begin(), rates.end(), window.begin, before),
          std::lower_bound(rates.begin(), rates.end(), window.end, before)};
}

std::unique_ptr<Segmenter> make_segmenter(const SegmentOptions& options, const UndistortMap& undistort) {
  if (options.method == SegmentMethod::kTrack) return std::make_unique<TrackSegmenter>(options, undistort);
  return std::make_unique<ClusterSegmenter>(options, undistort);
}

}  // namespace idol
