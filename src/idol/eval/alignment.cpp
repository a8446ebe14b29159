#include "idol/eval/alignment.hpp"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

/// Directions whose share of the correlation is below this are open: a line so straight (1e-6 of its
/// length) that the digits of the files decide the rotation about it.
constexpr double kOpenDirection = 1e-12;

/// Spread of positions, as a share of their size, that is only the rounding of their mean.
constexpr double kRounding = 1e-12;

/// First and second moments of the matched positions.
struct Moments {
  Vec3 mean_gt = Vec3::Zero();
  Vec3 mean_est = Vec3::Zero();
  Mat3 correlation = Mat3::Zero();  ///< mean of (x_gt - mean_gt) (x_est - mean_est)^T [m^2]
  double variance_est = 0;          ///< mean of |x_est - mean_est|^2 [m^2]
  Mat3 rotation = Mat3::Zero();     ///< mean of R_gt R_est^T
};

Moments moments(const MatchedPoses& pairs) {
  Moments m;
  const double n = static_cast<double>(pairs.size());
  double largest_gt = 0;
  double largest_est = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    m.mean_gt += pairs.groundtruth[i].T.p;
    m.mean_est += pairs.estimate[i].T.p;
    m.rotation += pairs.groundtruth[i].T.R() * pairs.estimate[i].T.R().transpose();
    largest_gt = std::max(largest_gt, pairs.groundtruth[i].T.p.norm());
    largest_est = std::max(largest_est, pairs.estimate[i].T.p.norm());
  }
  m.mean_gt /= n;
  m.mean_est /= n;
  m.rotation /= n;
  double variance_gt = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Vec3 gt = pairs.groundtruth[i].T.p - m.mean_gt;
    const Vec3 est = pairs.estimate[i].T.p - m.mean_est;
    m.correlation += gt * est.transpose();
    m.variance_est += est.squaredNorm();
    variance_gt += gt.squaredNorm();
  }
  m.correlation /= n;
  m.variance_est /= n;
  variance_gt /= n;
  // Equal positions differ from their mean by its rounding, which is not a direction.
  if (std::sqrt(m.variance_est) <= kRounding * largest_est) m.variance_est = 0;
  if (m.variance_est == 0 || std::sqrt(variance_gt) <= kRounding * largest_gt) m.correlation.setZero();
  return m;
}

/// Rotation maximising trace(R^T C) and the value of that trace (Umeyama 1991, eqs. 40-43).
std::pair<Mat3, double> best_rotation(const Mat3& C, bool& open) {
  if (!C.allFinite()) throw DataError("the positions are too large to be aligned");
  const Eigen::JacobiSVD<Mat3> svd(C, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vec3 d = Vec3::Zero();
  if (svd.info() == Eigen::Success) d = svd.singularValues();
  const double handedness = svd.matrixU().determinant() * svd.matrixV().determinant();
  const Vec3 signs(1, 1, handedness < 0 ? -1 : 1);
  open = !(d[1] > kOpenDirection * d[0]);
  return {svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose(), d.dot(signs)};
}

/// Rotation about z maximising trace(Rz^T C).
Mat3 best_yaw(const Mat3& C, bool& open) {
  const double sine = C(1, 0) - C(0, 1);
  const double cosine = C(0, 0) + C(1, 1);
  open = !(std::hypot(sine, cosine) > kOpenDirection * C.norm());
  return Eigen::AngleAxisd(std::atan2(sine, cosine), Vec3::UnitZ()).toRotationMatrix();
}

/// `correlation` with a trace of the orientations in it: too little to move what the positions determine,
/// enough to settle what they leave open. Positions all in one place have no say at all.
Mat3 completed(const Moments& m) {
  constexpr double kSay = 1e-9;
  const double spread = m.correlation.norm();
  return spread > 0 ? Mat3(m.correlation / spread + kSay * m.rotation) : m.rotation;
}

double bounding_box_diagonal(const Trajectory& trajectory) {
  Vec3 low = trajectory.front().T.p;
  Vec3 high = low;
  for (const StampedPose& pose : trajectory) {
    low = low.cwiseMin(pose.T.p);
    high = high.cwiseMax(pose.T.p);
  }
  return (high - low).norm();
}

Alignment start_alignment(const MatchedPoses& pairs) {
  if (pairs.size() == 0) throw DataError("no matched pose to align on");
  Alignment result;
  result.poses = pairs.size();
  result.span_m = bounding_box_diagonal(pairs.groundtruth);
  return result;
}

}  // namespace

std::optional<AlignmentKind> parse_alignment_kind(std::string_view name) {
  for (const AlignmentKind kind :
       {AlignmentKind::kNone, AlignmentKind::kPosYaw, AlignmentKind::kSe3, AlignmentKind::kSim3})
    if (alignment_name(kind) == name) return kind;
  return std::nullopt;
}

std::string alignment_name(AlignmentKind kind) {
  switch (kind) {
    case AlignmentKind::kPosYaw:
      return "posyaw";
    case AlignmentKind::kSe3:
      return "se3";
    case AlignmentKind::kSim3:
      return "sim3";
    case AlignmentKind::kNone:
      break;
  }
  return "none";
}

std::string PoseSelection::describe() const {
  if (first) return fmt::format("first {}", *first);
  if (seconds) return fmt::format("{:g}-{:g} s", seconds->first, seconds->second);
  return "all";
}

MatchedPoses select_poses(const MatchedPoses& pairs, Time start, const PoseSelection& selection) {
  MatchedPoses selected;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (selection.first && i >= *selection.first) break;
    const double t = seconds_between(start, pairs.estimate[i].t);
    if (selection.seconds && (t < selection.seconds->first || t > selection.seconds->second)) continue;
    selected.estimate.push_back(pairs.estimate[i]);
    selected.groundtruth.push_back(pairs.groundtruth[i]);
  }
  return selected;
}

Alignment align(const MatchedPoses& pairs, AlignmentKind kind) {
  Alignment result = start_alignment(pairs);
  if (kind == AlignmentKind::kNone) return result;
  const Moments m = moments(pairs);
  Similarity& T = result.T;
  bool still_open = false;
  if (kind == AlignmentKind::kPosYaw) {
    T.R = best_yaw(m.correlation, result.from_rotations);
    if (result.from_rotations) T.R = best_yaw(completed(m), still_open);
  } else {
    const auto [R, trace] = best_rotation(m.correlation, result.from_rotations);
    T.R = result.from_rotations ? best_rotation(completed(m), still_open).first : R;
    // An estimate that never moves tells nothing about its scale.
    if (kind == AlignmentKind::kSim3 && pairs.size() > 1 && m.variance_est > 0)
      T.scale = trace / m.variance_est;
  }
  T.t = m.mean_gt - T.scale * (T.R * m.mean_est);
  return result;
}

Alignment align_yaw_from_rotations(const MatchedPoses& pairs) {
  Alignment result = start_alignment(pairs);
  const Moments m = moments(pairs);
  bool still_open = false;
  result.T.R = best_yaw(m.rotation, still_open);
  result.T.t = m.mean_gt - result.T.R * m.mean_est;
  result.from_rotations = true;
  return result;
}

}  // namespace idol
