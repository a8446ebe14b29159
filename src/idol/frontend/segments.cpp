#include "idol/frontend/segments.hpp"

#include "idol/frontend/cluster_segmenter.hpp"
#include "idol/frontend/track_segmenter.hpp"

namespace idol {

std::unique_ptr<Segmenter> make_segmenter(const SegmentOptions& options, const UndistortMap& undistort) {
  if (options.method == SegmentMethod::kTrack) return std::make_unique<TrackSegmenter>(options, undistort);
  return std::make_unique<ClusterSegmenter>(options, undistort);
}

}  // namespace idol
