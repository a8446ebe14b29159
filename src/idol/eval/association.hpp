// Which estimate pose is compared with which ground-truth pose. Definitions: docs/evaluation.md.
#pragma once

#include <cstddef>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// Farthest two stamps may lie apart to be matched [s].
constexpr double kMaxMatchDifference = 0.02;
/// Widest hole between two ground-truth poses that is interpolated over [s].
constexpr double kMaxInterpolationGap = 0.1;

/// Indices of an estimate pose and of its ground-truth pose.
struct Match {
  std::size_t estimate = 0;
  std::size_t groundtruth = 0;

  bool operator==(const Match&) const = default;
};

/// Estimate and ground truth pose by pose: equally long, in time order.
struct MatchedPoses {
  Trajectory estimate;
  Trajectory groundtruth;

  [[nodiscard]] std::size_t size() const { return estimate.size(); }
};

/// Seconds of a stamp, the double nearest to its decimal number (what a text parser would give).
double stamp_seconds(Time t);

/// Nearest-stamp association, closest pairs first, each pose used once; ties go to the earlier estimate,
/// then the earlier ground truth. Pairs less than `max_difference_s` apart only. O(n log n).
/// Both trajectories in increasing time order; so are the matches.
std::vector<Match> associate(const Trajectory& estimate, const Trajectory& groundtruth,
                             double max_difference_s = kMaxMatchDifference);

/// The associated poses side by side.
MatchedPoses match_nearest(const Trajectory& estimate, const Trajectory& groundtruth,
                           double max_difference_s = kMaxMatchDifference);

/// Every estimate pose with ground truth interpolated at its own stamp; poses outside the ground truth's
/// time, or in a hole of it wider than `max_gap_s`, are dropped.
MatchedPoses match_interpolated(const Trajectory& estimate, const Trajectory& groundtruth,
                                double max_gap_s = kMaxInterpolationGap);

/// Share of [begin, end] that the estimate covers. Holes of the estimate (longer than 1 s and than five of
/// its median intervals) count as not covered.
double time_coverage(const Trajectory& estimate, Time begin, Time end);

}  // namespace idol
