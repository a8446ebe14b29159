// A 3D line by its four degrees of freedom, seen from a fixed camera pose: each of two ends moves across the
// line in that image and in inverse depth, never along the line. Projections are nearly linear in these
// numbers, however little is known of the depth, and nothing happens at infinity.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "idol/backend/chain_system.hpp"
#include "idol/backend/residuals.hpp"

namespace idol {

using Vec4 = Eigen::Vector4d;

/// What of a line never changes: camera pose when it was made, and its image then.
struct LineAnchor {
  Pose T_w_c;
  Vec2 a = Vec2::Zero(), b = Vec2::UnitX();  ///< ends in normalised coordinates
  Vec2 normal = Vec2::UnitY();               ///< unit, across the line

  /// `a_px`, `b_px`: undistorted pixels of two ends.
  static LineAnchor from_image(const Pose& T_w_c, const Vec2& a_px, const Vec2& b_px, const Camera& camera);
};

/// Coordinates: [offset of a, inverse depth of a, offset of b, inverse depth of b], offsets in normalised
/// coordinates, inverse depths in 1/m.
struct AnchoredLine {
  LineAnchor anchor;
  Vec4 coordinates = Vec4(0, 1, 0, 1);

  [[nodiscard]] HomogeneousPoint end_a() const { return end(anchor.a, coordinates[0], coordinates[1]); }
  [[nodiscard]] HomogeneousPoint end_b() const { return end(anchor.b, coordinates[2], coordinates[3]); }
  /// Adds `step` to the coordinates, but never through infinity: that would come back behind the camera.
  void move(const Vec4& step);
  /// In front of the anchor camera, between 1 mm and 100 km away, and near its image there: a line, not what
  /// a divergence leaves of one.
  [[nodiscard]] bool finite() const;
  /// The two ends in the world; only if finite().
  [[nodiscard]] LineEnds ends() const;
  /// Coordinates, about `anchor`, of the line through two points of the world; nullopt if either end would
  /// not be in front of the anchor's camera.
  [[nodiscard]] static std::optional<Vec4> coordinates_of(const LineEnds& ends, const LineAnchor& anchor);
  /// Columns: how the coordinates change when the world is shifted along its x, y, z [1/m] or turned about
  /// its z axis [1/rad].
  [[nodiscard]] Eigen::Matrix4d world_moves() const;

 private:
  [[nodiscard]] HomogeneousPoint end(const Vec2& m, double offset, double inverse_depth) const;
};

/// Events of one line within some milliseconds as two points at one time (line_moments.hpp).
struct LineBin {
  Vec2 a_px = Vec2::Zero(), b_px = Vec2::Zero();
  Vec2 a_heading = Vec2::Zero(), b_heading = Vec2::Zero();  ///< MovingLine::heading there
  int slot = 0;                                             ///< which of the window's bin times
  int count = 0;                                            ///< events
  double scatter_px = 0;  ///< standard deviation of its line's events across it

  /// The points carried on by the events' lag.
  [[nodiscard]] Vec2 a(double lag_px) const { return a_px + lag_px * a_heading; }
  [[nodiscard]] Vec2 b(double lag_px) const { return b_px + lag_px * b_heading; }
};

/// Distances [px] of a bin's two points, carried on by the events' lag, from the line; nullopt where the line
/// has no image.
std::optional<Vec2> bin_distances(const LineBin& bin, double event_lag_px, const AnchoredLine& line,
                                  const TimedCamera& timed, const Camera& camera);

/// The same with Jacobians.
struct BinResidual {
  Vec2 value = Vec2::Zero();
  /// To the camera's motion, TimedCamera::at(): by_state() of the camera makes it one to the state, but
  /// for the event lag, whose column is the last.
  Eigen::Matrix<double, 2, 7> d_camera;
  Eigen::Matrix<double, 2, 4> d_line;
  /// To a rotation of the camera in the IMU's frame on the right, T_i_c Exp(d) [1/rad], and to the log of the
  /// focal length.
  Eigen::Matrix<double, 2, 4> d_calibration;
  bool valid = false;
};
BinResidual bin_to_line(const LineBin& bin, double event_lag_px, const AnchoredLine& line,
                        const TimedCamera& timed, const Camera& camera);

}  // namespace idol
