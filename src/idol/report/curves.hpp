// Curves against time, prepared for the page: compared with ground truth, thinned without losing extremes.
#pragma once

#include <string>
#include <vector>

#include "idol/eval/alignment.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {

/// One curve. NaN is a gap.
struct Series {
  std::string name;
  int colour = 0;         ///< index into the page's colours: 0, 1, 2 are also x, y, z
  std::string style;      ///< "", "truth" (wide and pale), "causal", "error", "thin" or "dashed"
  std::vector<double> t;  ///< [s] since the page's zero
  std::vector<double> y;
  std::vector<double> band;  ///< half the width of the band around y; empty: none
};

/// Curves that share an axis.
struct Panel {
  std::string group;  ///< "state", "error", "front-end" or "back-end"
  std::string title;
  std::string unit;
  std::vector<Series> series;
};

/// Ground truth in the world of the estimate.
struct AlignedTruth {
  MatchedPoses matched;  ///< estimate and ground truth, the latter still in its own world
  Similarity alignment;  ///< posyaw, over all matched poses: estimate -> ground truth
  Trajectory camera;     ///< whole ground truth, within the estimate's time, in the estimate's world
};

/// Empty when either is empty or nothing matches.
AlignedTruth align_truth(const Trajectory& estimate, const Trajectory& groundtruth);

/// All panels that the folder has data for. `zero` is the page's time zero. `truth` and `causal_truth`
/// belong to the smoothed and to the causal trajectory of the camera.
std::vector<Panel> make_panels(const RunFolder& run, const AlignedTruth& truth,
                               const AlignedTruth& causal_truth, Time zero);

/// Velocity at each stamp but the first and last `half`: slope of the least-squares line through the
/// positions from `half` poses before to `half` after [m/s].
std::vector<Vec3> smoothed_velocity(const Trajectory& trajectory, std::size_t half);

/// At most 2 `buckets` points: the smallest and the largest of each of `buckets` equal pieces, in order.
/// A shorter series is returned as it is.
Series thin(const Series& series, std::size_t buckets);

}  // namespace idol
