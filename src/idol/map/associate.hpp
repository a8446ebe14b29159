// Which image segments are which lines of the map, decided for all of them together.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "idol/backend/residuals.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// A segment in the image, undistorted pixels, and the camera's estimated pose at its time.
struct ImageSegment {
  LineId id = kNoLine;
  Vec2 a = Vec2::Zero(), b = Vec2::Zero();
  Pose T_w_c;
};

/// A line of the map that may be in sight.
struct MapSegment {
  LineId id = kNoLine;
  LineEnds ends;
};

struct LineMatch {
  LineId segment = kNoLine, line = kNoLine;
};

/// How far the estimate is from the map: shift of the camera [m] along the world's axes, and turn about the
/// vertical through the camera [rad]. Roll and pitch are known from gravity.
using MapOffset = Eigen::Vector4d;

struct Association {
  std::vector<LineMatch> matches;  ///< by segment
  MapOffset offset = MapOffset::Zero();
  int runner_up = 0;  ///< matches of the best offset that contradicts this one
};

/// The offset within its covariance under which most segments lie on lines of the map, and these pairs;
/// nullopt where too few do, or where another offset explains nearly as many, as in repeating structure.
std::optional<Association> associate(std::span<const ImageSegment> segments,
                                     std::span<const MapSegment> lines, const Camera& camera,
                                     const Eigen::Matrix4d& offset_covariance);

/// Whether a line's image may be within sight, give or take half the image.
bool may_be_in_sight(const LineEnds& ends, const Pose& T_w_c, const Camera& camera);

}  // namespace idol
