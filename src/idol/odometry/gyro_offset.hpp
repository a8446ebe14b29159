// How far the stamps of camera and gyro are apart, by how the image turns: a coarse search over offsets.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <span>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"
#include "idol/frontend/segments.hpp"

namespace idol {

/// Each window's lines say how the camera turned in it, together with a translation for which all depths are
/// taken as one: the rate's estimate and its information. The offset at which the gyro agrees best with these
/// is looked for, its bias unknown. Lines with very different depths spoil a window's estimate; over many
/// windows with changing rates the best offset is good to some 15 ms. docs/backend.md, "Time offset".
class GyroOffset {
 public:
  explicit GyroOffset(const Camera& camera) : camera_(camera) {}

  /// The next window, stamped by the IMU's clock as far as it is known.
  void add(const EventWindow& window, std::span<const Segment> segments);
  /// Forgets windows that begin before `t`.
  void drop_before(Time t);

  struct Result {
    double offset_s = 0;    ///< by which windows must be moved to agree with the gyro [s]
    double cost_here = 0;   ///< robust sum of squared errors, in sigmas, with windows as they are
    double cost_best = 0;   ///< there
    bool distinct = false;  ///< the costs rise clearly on both sides of the best
    /// The windows contradict the offset that they have.
    [[nodiscard]] bool wrong_here() const;
  };
  /// `rates`: of the gyro in the camera's frame, in time order. Windows count that these cover at all
  /// offsets looked at. nullopt for too few windows.
  [[nodiscard]] std::optional<Result> search(std::span<const CameraRate> rates) const;

 private:
  struct Turn {
    Time begin = 0, end = 0;
    Vec3 omega = Vec3::Zero();        // mean rate in the camera's frame [rad/s]
    Mat3 information = Mat3::Zero();  // of it
  };

  Camera camera_;
  std::deque<Turn> turns_;
};

}  // namespace idol
