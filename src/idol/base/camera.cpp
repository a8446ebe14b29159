#include "idol/base/camera.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

/// True if the lens's radius grows all the way from the centre to the normalised radius `r`: beyond a fold of
/// the polynomial Newton finds points that no lens images there.
bool grows_up_to(const Camera& camera, double r) {
  const auto& k = camera.coeffs;
  const bool equidistant = camera.distortion == Distortion::kEquidistant;
  const double last = equidistant ? std::atan(r) : r;
  constexpr int kSteps = 16;
  for (int i = 1; i <= kSteps; ++i) {
    const double s = last * i / kSteps;
    const double s2 = s * s;
    const double slope = equidistant ? 1 + s2 * (3 * k[0] + s2 * (5 * k[1] + s2 * (7 * k[2] + s2 * 9 * k[3])))
                                     : 1 + s2 * (3 * k[0] + s2 * (5 * k[1] + s2 * 7 * k[4]));
    if (!(slope > 0)) return false;
  }
  return true;
}

}  // namespace

Vec2 Camera::distort(const Vec2& n) const {
  const auto& k = coeffs;
  Vec2 d = n;
  const double r2 = n.squaredNorm();
  if (distortion == Distortion::kRadTan) {
    const double radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    const double xy = n.x() * n.y();
    d = radial * n + Vec2(2 * k[2] * xy + k[3] * (r2 + 2 * n.x() * n.x()),
                          k[2] * (r2 + 2 * n.y() * n.y()) + 2 * k[3] * xy);
  } else if (distortion == Distortion::kEquidistant && r2 > 1e-16) {
    const double r = std::sqrt(r2);
    const double theta = std::atan(r);
    const double t2 = theta * theta;
    d = n * (theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) / r);
  }
  return {fx * d.x() + cx, fy * d.y() + cy};
}

Vec2 Camera::undistort(const Vec2& raw_px) const {
  if (distortion == Distortion::kNone) return raw_px;
  Vec2 n = normalise(raw_px);
  constexpr double kStep = 1e-6;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const Vec2 error = distort(n) - raw_px;
    if (error.norm() < 1e-9) break;
    Eigen::Matrix2d J;
    J.col(0) = (distort(n + Vec2(kStep, 0)) - distort(n - Vec2(kStep, 0))) / (2 * kStep);
    J.col(1) = (distort(n + Vec2(0, kStep)) - distort(n - Vec2(0, kStep))) / (2 * kStep);
    Vec2 step = J.inverse() * error;
    // A strongly distorted lens can throw the first step across the fold of the model.
    const double longest = 0.2 * (1.0 + n.norm());
    if (!(step.norm() < longest)) step *= longest / step.norm();
    n -= step;
  }
  if (!((distort(n) - raw_px).norm() < 1e-3) || !grows_up_to(*this, n.norm())) {
    throw DataError(
        fmt::format("the lens model cannot be inverted at pixel ({}, {}): check the distortion "
                    "coefficients and the resolution",
                    raw_px.x(), raw_px.y()));
  }
  return {fx * n.x() + cx, fy * n.y() + cy};
}

void Camera::check(const std::string& source) const {
  if (width < 1 || height < 1 || width > 8192 || height > 8192)
    throw DataError(fmt::format("{}: resolution {} x {} makes no sense", source, width, height));
  if (!(fx > 0) || !(fy > 0) || !std::isfinite(fx + fy + cx + cy))
    throw DataError(fmt::format("{}: focal lengths must be positive, got fx {} fy {}", source, fx, fy));
  for (double k : coeffs)
    if (!std::isfinite(k))
      throw DataError(fmt::format("{}: a distortion coefficient is not a number", source));
}

UndistortMap::UndistortMap(int width, int height) : width_(width), height_(height) {
  map_.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) map_.emplace_back(static_cast<float>(x), static_cast<float>(y));
}

UndistortMap::UndistortMap(const Camera& camera) : UndistortMap(camera.width, camera.height) {
  for (auto& px : map_) px = camera.undistort(px.cast<double>()).cast<float>();
  focal_ = {camera.fx, camera.fy};
  centre_ = {camera.cx, camera.cy};
}

Vec2 UndistortMap::rotational_flow(const Vec2& px, const Vec3& omega) const {
  if (focal_.x() == 0) return Vec2::Zero();
  const Vec2 m = (px - centre_).cwiseQuotient(focal_);
  const Vec3 turn = m.homogeneous().cross(omega);  // of the point in the camera's frame
  return focal_.cwiseProduct(turn.head<2>() - m * turn.z());
}

}  // namespace idol
