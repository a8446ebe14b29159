#include "idol/eval/metrics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace idol {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

/// |a - b|, summed in the order x, y, z: distances that tie in another implementation tie here.
double step_length(const Vec3& a, const Vec3& b) {
  const Vec3 d = b - a;
  return std::sqrt(d.x() * d.x() + d.y() * d.y() + d.z() * d.z());
}

double median_of_sorted(const std::vector<double>& sorted) {
  const std::size_t half = sorted.size() / 2;
  return sorted.size() % 2 == 1 ? sorted[half] : 0.5 * (sorted[half - 1] + sorted[half]);
}

}  // namespace

Stats statistics(std::vector<double> values) {
  // Of truth without orientation: no figures.
  if (std::any_of(values.begin(), values.end(), [](double v) { return std::isnan(v); })) values.clear();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  if (values.empty()) return {kNan, kNan, kNan, kNan, kNan, kNan};
  std::sort(values.begin(), values.end());
  const double n = static_cast<double>(values.size());
  double sum = 0;
  double squares = 0;
  for (const double v : values) {
    sum += v;
    squares += v * v;
  }
  const double mean = sum / n;
  double deviations = 0;
  for (const double v : values) deviations += (v - mean) * (v - mean);
  return {std::sqrt(squares / n),    mean,           median_of_sorted(values),
          std::sqrt(deviations / n), values.front(), values.back()};
}

RotationError rotation_error(const Quat& error) {
  const Mat3 R = error.toRotationMatrix();
  const double yaw = std::atan2(R(1, 0), R(0, 0));
  const double pitch = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  const double roll = std::atan2(R(2, 1), R(2, 2));
  return {kDegrees * quat_log(error).norm(), kDegrees * std::abs(yaw), kDegrees * std::hypot(pitch, roll)};
}

AbsoluteErrors absolute_errors(const MatchedPoses& pairs, const Similarity& alignment) {
  AbsoluteErrors errors;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Pose& gt = pairs.groundtruth[i].T;
    const Pose est = alignment * pairs.estimate[i].T;
    const RotationError rotation = rotation_error((est.q * gt.q.conjugate()).normalized());
    errors.translation_m.push_back((gt.p - est.p).norm());
    errors.rotation_deg.push_back(rotation.angle_deg);
    errors.yaw_deg.push_back(rotation.yaw_deg);
    errors.tilt_deg.push_back(rotation.tilt_deg);
  }
  return errors;
}

std::vector<double> accumulated_distances(const Trajectory& trajectory) {
  std::vector<double> distances(trajectory.size(), 0.0);
  for (std::size_t i = 1; i < trajectory.size(); ++i)
    distances[i] = distances[i - 1] + step_length(trajectory[i - 1].T.p, trajectory[i].T.p);
  return distances;
}

double path_length(const Trajectory& trajectory) {
  return trajectory.empty() ? 0.0 : accumulated_distances(trajectory).back();
}

double matched_length(const MatchedPoses& pairs, const Trajectory& groundtruth) {
  if (pairs.size() == 0) return 0.0;
  const StampedPose& first = pairs.groundtruth.front();
  const StampedPose& last = pairs.groundtruth.back();
  Trajectory path{first};
  for (const StampedPose& pose : groundtruth)
    if (pose.t > first.t && pose.t < last.t) path.push_back(pose);
  path.push_back(last);
  return path_length(path);
}

double segment_length(int percent, double path_length_m) {
  const double share = percent / 100.0;
  return std::trunc(share * path_length_m * 100.0) / 100.0;
}

std::vector<std::size_t> segment_ends(const std::vector<double>& distances, double length_m) {
  std::vector<std::size_t> ends(distances.size(), kNoSegmentEnd);
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const double target = distances[i] + length_m;
    const auto start = distances.begin() + static_cast<std::ptrdiff_t>(i);
    double best = 0.2 * length_m;
    const auto consider = [&](std::vector<double>::const_iterator j) {
      if (!(std::abs(*j - target) < best)) return;
      best = std::abs(*j - target);
      ends[i] = static_cast<std::size_t>(j - distances.begin());
    };
    const auto beyond = std::lower_bound(start, distances.end(), target);
    // The first of those that tie in front of the target, then the first at or behind it.
    if (beyond != start) consider(std::lower_bound(start, beyond, *std::prev(beyond)));
    if (beyond != distances.end()) consider(beyond);
  }
  return ends;
}

RelativeErrors relative_errors(const MatchedPoses& pairs, double length_m, double scale) {
  RelativeErrors errors;
  errors.length_m = length_m;
  const std::vector<std::size_t> ends = segment_ends(accumulated_distances(pairs.groundtruth), length_m);
  for (std::size_t i = 0; i < ends.size(); ++i) {
    if (ends[i] == kNoSegmentEnd) continue;
    const Pose gt = pairs.groundtruth[i].T.inverse() * pairs.groundtruth[ends[i]].T;
    Pose est = pairs.estimate[i].T.inverse() * pairs.estimate[ends[i]].T;
    est.p *= scale;
    const Pose error = gt.inverse() * est;
    const Quat& q_end = pairs.estimate[ends[i]].T.q;
    const RotationError rotation = rotation_error((q_end * error.q * q_end.conjugate()).normalized());
    const double translation = error.p.norm();
    errors.translation_m.push_back(translation);
    errors.translation_percent.push_back(translation / length_m * 100.0);
    errors.rotation_deg.push_back(rotation.angle_deg);
    errors.rotation_deg_per_m.push_back(rotation.angle_deg / length_m);
    errors.yaw_deg.push_back(rotation.yaw_deg);
    errors.tilt_deg.push_back(rotation.tilt_deg);
  }
  return errors;
}

}  // namespace idol
