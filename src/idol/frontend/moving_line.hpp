// A straight line moving in the image, fitted to events of a short time span: the test that a cluster is a
// line.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

namespace idol {

/// Position and time of an event: px, px, s since the window's begin.
using TimedPixel = Eigen::Vector3d;

/// In a frame along (u) and across (w) the line: w = c0 + c1 u + (c2 + c3 u) t + c4 t^2, u and w from
/// `origin`, t from `time`. Exact for a line under constant image velocity and rotation rate to first order.
struct MovingLine {
  Eigen::Vector2d origin = Eigen::Vector2d::Zero();      ///< [px]
  Eigen::Vector2d direction = Eigen::Vector2d::UnitX();  ///< unit, along u
  double time = 0;                                       ///< middle of the span [s]
  Eigen::Matrix<double, 5, 1> c = Eigen::Matrix<double, 5, 1>::Zero();
  double u_min = 0, u_max = 0;  ///< extent along u of the inliers (2nd to 98th percentile)
  double rms_px = 0;            ///< of the inliers
  double bow_px = 0;            ///< sagitta: how far the inliers bend away from straight over the extent

  /// Distance of an event from the line at its own time [px], signed.
  [[nodiscard]] double distance(const TimedPixel& event) const;
  /// Position along the line [px].
  [[nodiscard]] double along(const TimedPixel& event) const;
  /// Point of the line at position u and time t [px].
  [[nodiscard]] Eigen::Vector2d point(double u, double t) const;
  /// Unit vector across the line, to where its point u moves at time t; fades out below some 10 px/s.
  [[nodiscard]] Eigen::Vector2d heading(double u, double t) const;
  /// The same line at constant velocity from its middle time on: a parabola must not be carried far.
  [[nodiscard]] MovingLine extrapolable() const {
    MovingLine out = *this;
    out.c[4] = 0;
    return out;
  }
  [[nodiscard]] double length_px() const { return u_max - u_min; }
};

/// How far a straight line of that length may seem to bend, by `events` that scatter by `sigma` across it:
/// `max_bow_px`, or a share of the length where that is less, and what sampling alone makes of it: the
/// sagitta's standard deviation is 3.35 sigma / sqrt(n) [px].
inline double most_bow_px(double max_bow_px, double length, double sigma, double events) {
  constexpr double kShare = 0.04;
  return std::min(max_bow_px, kShare * length) + 2 * 3.35 * sigma / std::sqrt(events);
}

/// Least squares with the events beyond `gate_px` (or 2.5 sigma, if larger than half of the gate) left out,
/// three rounds. `normal`: a first guess of the line's normal, to some 30 degrees. nullopt for fewer than 8
/// inliers.
std::optional<MovingLine> fit_moving_line(std::span<const TimedPixel> events, const Eigen::Vector2d& normal,
                                          double gate_px);

}  // namespace idol
