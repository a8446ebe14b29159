#include "idol/frontend/segments.hpp"

#include <algorithm>

#include "idol/frontend/cluster_segmenter.hpp"
#include "idol/frontend/track_segmenter.hpp"

namespace idol {

void SegmenterCounts::add(const EventWindow& window, std::span<const LineId> ids) {
  const auto fresh = ids.subspan(window.overlap);
  const auto left_out = static_cast<std::int64_t>(window.flicker);
  flicker += left_out;
  events += std::ssize(fresh) + left_out;
  in_segments += std::count_if(fresh.begin(), fresh.end(), [](LineId id) { return id != kNoLine; });
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
