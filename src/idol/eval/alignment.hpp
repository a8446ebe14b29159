// The transformation that lays an estimate over ground truth. Umeyama 1991; Zhang & Scaramuzza 2018.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "idol/eval/association.hpp"

namespace idol {

enum class AlignmentKind { kNone, kPosYaw, kSe3, kSim3 };

/// none | posyaw | se3 | sim3; nullopt for any other word.
std::optional<AlignmentKind> parse_alignment_kind(std::string_view name);
std::string alignment_name(AlignmentKind kind);

/// x_groundtruth = scale * R * x_estimate + t.
struct Similarity {
  double scale = 1.0;
  Mat3 R = Mat3::Identity();
  Vec3 t = Vec3::Zero();

  [[nodiscard]] Pose operator*(const Pose& T) const {
    return {(Quat(R) * T.q).normalized(), scale * (R * T.p) + t};
  }
};

/// Which matched poses an alignment uses. Both unset: all of them.
struct PoseSelection {
  std::optional<std::size_t> first;                  ///< the first N matched poses
  std::optional<std::pair<double, double>> seconds;  ///< [from, to] since the estimate's start [s]

  [[nodiscard]] std::string describe() const;
};

struct Alignment {
  Similarity T;
  std::size_t poses = 0;  ///< poses used
  double span_m = 0;      ///< largest distance between two corners of their ground truth's bounding box [m]
  bool from_rotations = false;  ///< the positions leave the rotation (partly) open: the orientations decided
};

/// The matched poses that are selected; `start` is the estimate's first stamp.
MatchedPoses select_poses(const MatchedPoses& pairs, Time start, const PoseSelection& selection);

/// Least squares on positions. Where these leave the rotation open (one pose, all poses in one place or on
/// one line) the mean relative orientation decides what is open. Throws DataError without a pose.
Alignment align(const MatchedPoses& pairs, AlignmentKind kind);

/// posyaw with the yaw that best turns the estimate's orientations onto the ground truth's; the translation
/// as usual. For poses so close together that noise decides the yaw of their positions.
Alignment align_yaw_from_rotations(const MatchedPoses& pairs);

}  // namespace idol
