#include "idol/sim/renderer.hpp"

#include <algorithm>
#include <cmath>

namespace idol {
namespace {

constexpr double kNear = 0.05;  // [m]: polygons are cut at this depth

double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

Renderer::Renderer(const Scene& scene, const Camera& camera)
    : scene_(scene), camera_(camera), undistort_(camera),
      intensity_(static_cast<std::size_t>(camera.width * camera.height)), coverage_(intensity_.size()) {
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x)
      margin_px_ = std::max(margin_px_, static_cast<double>((undistort_(x, y) - Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y))).norm()));
}

const std::vector<float>& Renderer::render(const Pose& T_w_c) {
  std::fill(intensity_.begin(), intensity_.end(), static_cast<float>(scene_.background));
  const Pose T_c_w = T_w_c.inverse();
  for (const auto& shape : scene_.shapes) draw(shape, T_c_w);
  return intensity_;
}

// Pieces of one shape add up, so that the seams between them vanish; then the shape covers what is behind it.
void Renderer::draw(const Shape& shape, const Pose& T_c_w) {
  const auto outline = project(shape.outline, T_c_w);
  if (outline.empty()) return;
  std::fill(coverage_.begin(), coverage_.end(), 0.0F);
  for (const auto& piece : shape.pieces) cover(project(piece, T_c_w));
  for (std::size_t i = 0; i < intensity_.size(); ++i) {
    const float c = std::min(coverage_[i], 1.0F);
    if (c > 0) intensity_[i] += c * (static_cast<float>(shape.brightness) - intensity_[i]);
  }
}

// Share of each pixel inside a convex polygon: the distance to its nearest edge, over one pixel.
void Renderer::cover(const std::vector<Vec2>& polygon) {
  if (polygon.size() < 3) return;
  Vec2 low = polygon[0], high = polygon[0];
  double area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    low = low.cwiseMin(polygon[i]);
    high = high.cwiseMax(polygon[i]);
    area += cross(polygon[i] - polygon[0], polygon[(i + 1) % polygon.size()] - polygon[0]);
  }
  if (std::abs(area) < 1e-9) return;
  struct Edge {
    double a, b, c;
  };
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2 d = polygon[(i + 1) % polygon.size()] - polygon[i];
    const double length = d.norm();
    if (length < 1e-9) continue;
    const double sign = area > 0 ? 1 / length : -1 / length;
    edges.push_back({-d.y() * sign, d.x() * sign, sign * (d.y() * polygon[i].x() - d.x() * polygon[i].y())});
  }
  // Undistorted positions differ from raw ones by at most the margin: visit the pixels that may lie inside.
  const auto bound = [](double v, int top) { return static_cast<int>(std::clamp(v, 0.0, static_cast<double>(top))); };
  const int x0 = bound(std::floor(low.x() - 1 > 0 ? low.x() - 1 - 0 : 0), camera_.width - 1);
  const int y0 = bound(std::floor(low.y() - 1 > 0 ? low.y() - 1 - 0 : 0), camera_.height - 1);
  const int x1 = bound(std::ceil(high.x() + 1), camera_.width - 1), y1 = bound(std::ceil(high.y() + 1), camera_.height - 1);
  const int grow = static_cast<int>(std::ceil(margin_px_));
  for (int y = std::max(0, y0 - grow); y <= std::min(camera_.height - 1, y1 + grow); ++y) {
    for (int x = std::max(0, x0 - grow); x <= std::min(camera_.width - 1, x1 + grow); ++x) {
      const Eigen::Vector2f& u = undistort_(x, y);
      double inside = 1;
      for (const auto& e : edges) {
        inside = std::min(inside, 0.5 + e.a * u.x() + e.b * u.y() + e.c);
        if (inside <= 0) break;
      }
      if (inside > 0)
        coverage_[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera_.width) + static_cast<std::size_t>(x)] +=
            static_cast<float>(inside);
    }
  }
}

// Cut at the near plane (Sutherland-Hodgman against one plane), then projected without distortion.
std::vector<Vec2> Renderer::project(const std::vector<Vec3>& polygon, const Pose& T_c_w) const {
  std::vector<Vec2> out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec3 a = T_c_w * polygon[i], b = T_c_w * polygon[(i + 1) % polygon.size()];
    if (a.z() >= kNear) out.push_back(camera_.project(a));
    if ((a.z() >= kNear) != (b.z() >= kNear)) {
      const double share = (kNear - a.z()) / (b.z() - a.z());
      out.push_back(camera_.project(a + share * (b - a)));
    }
  }
  return out;
}

double Renderer::motion_px(const Pose& from, const Pose& to) const {
  const Pose A = from.inverse(), B = to.inverse();
  const double width = camera_.width, height = camera_.height;
  double largest = 0;
  for (const auto& shape : scene_.shapes) {
    for (const auto& p : shape.outline) {
      const Vec3 a = A * p, b = B * p;
      if (a.z() < kNear || b.z() < kNear) continue;
      const Vec2 pa = camera_.project(a);
      // Corners far outside the image move faster than anything inside.
      if (pa.x() < -0.5 * width || pa.y() < -0.5 * height || pa.x() > 1.5 * width || pa.y() > 1.5 * height) continue;
      largest = std::max(largest, (camera_.project(b) - pa).norm());
    }
  }
  return largest;
}

}  // namespace idol
