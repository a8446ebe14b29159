// Errors of an estimate against ground truth. Definitions and their sources: docs/evaluation.md.
#pragma once

#include <cstddef>
#include <vector>

#include "idol/eval/alignment.hpp"

namespace idol {

/// Box of figures over a set of errors; all NaN for an empty set. The standard deviation is the population's.
struct Stats {
  double rmse;
  double mean;
  double median;
  double std;
  double min;
  double max;
};

Stats statistics(std::vector<double> values);

/// Rotation from truth to estimate in figures: its angle, and its yaw and tilt (z-y-x Euler angles: yaw is
/// the first, tilt the root of the sum of squares of pitch and roll), all >= 0 [deg].
struct RotationError {
  double angle_deg;
  double yaw_deg;
  double tilt_deg;
};

RotationError rotation_error(const Quat& error);

/// One entry per matched pose.
struct AbsoluteErrors {
  std::vector<double> translation_m;
  std::vector<double> rotation_deg;
  std::vector<double> yaw_deg;
  std::vector<double> tilt_deg;
};

/// Errors after `alignment`: |p_gt - p_est| and the rotation R_est R_gt^T (its angle is that of R_gt R_est^T;
/// its yaw is the one the rpg toolbox computes).
AbsoluteErrors absolute_errors(const MatchedPoses& pairs, const Similarity& alignment);

/// Distance travelled from the first pose to each pose [m].
std::vector<double> accumulated_distances(const Trajectory& trajectory);

/// Length of a whole trajectory [m].
double path_length(const Trajectory& trajectory);

/// Length of the ground truth between the first and the last matched stamp, over all its poses there [m].
/// With interpolated ends these are the path's ends.
double matched_length(const MatchedPoses& pairs, const Trajectory& groundtruth);

/// Errors over pieces of the path of (nearly) one length; one entry per start pose that has an end pose.
struct RelativeErrors {
  double length_m = 0;
  std::vector<double> translation_m;
  std::vector<double> translation_percent;
  std::vector<double> rotation_deg;
  std::vector<double> rotation_deg_per_m;
  std::vector<double> yaw_deg;
  std::vector<double> tilt_deg;
};

/// Piece length: `percent` of a path length, cut to whole centimetres.
double segment_length(int percent, double path_length_m);

constexpr std::size_t kNoSegmentEnd = static_cast<std::size_t>(-1);

/// For each start i the end j >= i whose distance is closest to that of i plus `length_m`, and less than 0.2
/// of `length_m` off (the first of equals); kNoSegmentEnd where there is none. O(n log n).
std::vector<std::size_t> segment_ends(const std::vector<double>& distances, double length_m);

/// Relative errors E = (T_gt,i^-1 T_gt,j)^-1 (s T_est,i^-1 T_est,j), s scaling the translation.
RelativeErrors relative_errors(const MatchedPoses& pairs, double length_m, double scale);

}  // namespace idol
