// The camera: a pinhole with radial-tangential or equidistant distortion, and its look-up table.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "idol/base/lie.hpp"

namespace idol {

enum class Distortion { kNone, kRadTan, kEquidistant };

/// Pinhole camera. Integer pixel coordinates are at pixel centres.
struct Camera {
  int width = 0;
  int height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< [px]
  Distortion distortion = Distortion::kNone;
  /// radtan: k1 k2 p1 p2 k3 (OpenCV's order); equidistant: k1 k2 k3 k4 and an unused zero.
  std::array<double, 5> coeffs{};

  /// Pixel of a point in the camera frame through the plain pinhole (undistorted image) [px].
  [[nodiscard]] Vec2 project(const Vec3& x_c) const {
    return {fx * x_c.x() / x_c.z() + cx, fy * x_c.y() / x_c.z() + cy};
  }
  /// Normalised coordinates (x/z, y/z) of an undistorted pixel.
  [[nodiscard]] Vec2 normalise(const Vec2& px) const { return {(px.x() - cx) / fx, (px.y() - cy) / fy}; }
  /// Raw pixel of normalised coordinates: distortion, then the intrinsics [px].
  [[nodiscard]] Vec2 distort(const Vec2& normalised) const;
  /// Undistorted pixel of a raw pixel, by Newton on distort() [px]. Throws DataError if it does not converge.
  [[nodiscard]] Vec2 undistort(const Vec2& raw_px) const;
  /// Throws DataError, naming `source`, unless sizes and focal lengths make sense.
  void check(const std::string& source) const;
};

/// Undistorted position of every sensor pixel, computed once.
class UndistortMap {
 public:
  explicit UndistortMap(const Camera& camera);
  /// A sensor without calibration: the identity.
  UndistortMap(int width, int height);

  [[nodiscard]] const Eigen::Vector2f& operator()(int x, int y) const {
    return map_[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x)];
  }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::size_t pixels() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  /// Velocity of an undistorted pixel of a static, far scene while the camera turns at `omega` (camera frame)
  /// [rad/s]; zero without a calibration [px/s].
  [[nodiscard]] Vec2 rotational_flow(const Vec2& px, const Vec3& omega) const;

 private:
  int width_, height_;
  Vec2 focal_ = Vec2::Zero(), centre_ = Vec2::Zero();  // of the undistorted image [px]
  std::vector<Eigen::Vector2f> map_;
};

}  // namespace idol
