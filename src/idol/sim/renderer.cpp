#include "idol/sim/renderer.hpp"

#include <algorithm>
#include <cmath>

namespace idol {
namespace {

constexpr double kNear = 0.05;  // [m]: polygons are cut at this depth

}  // namespace

Renderer::Renderer(const Scene& scene, const Camera& camera)
    : scene_(scene),
      camera_(camera),
      undistort_(camera),
      intensity_(static_cast<std::size_t>(camera.width * camera.height)),
      coverage_(intensity_.size()) {
  for (int y = 0; y < camera.height; ++y) {
    Row row{undistort_(0, y).y(), undistort_(0, y).y()};
    for (int x = 1; x < camera.width; ++x) {
      row.low = std::min(row.low, undistort_(x, y).y());
      row.high = std::max(row.high, undistort_(x, y).y());
    }
    rows_.push_back(row);
  }
}

const std::vector<float>& Renderer::render(const Pose& T_w_c) {
  std::fill(intensity_.begin(), intensity_.end(), static_cast<float>(scene_.background));
  const Pose T_c_w = T_w_c.inverse();
  for (const auto& shape : scene_.shapes) draw(shape, T_c_w);
  return intensity_;
}

// The positions that a polygon's edge may touch.
Renderer::Box Renderer::box_of(const std::vector<Vec2>& polygon) {
  Box box{polygon[0], polygon[0]};
  for (const auto& p : polygon) {
    box.low = box.low.cwiseMin(p);
    box.high = box.high.cwiseMax(p);
  }
  return {box.low.array() - 1, box.high.array() + 1};
}

// Pixels whose undistorted position lies in the box; along a row of pixels the undistorted x only grows.
template <class Visit>
void Renderer::for_each_pixel(const Box& box, Visit&& visit) const {
  for (int y = 0; y < camera_.height; ++y) {
    const Row& row = rows_[static_cast<std::size_t>(y)];
    if (row.high < box.low.y() || row.low > box.high.y()) continue;
    const Eigen::Vector2f* first = &undistort_(0, y);
    const Eigen::Vector2f* end = first + camera_.width;
    const auto* from = std::partition_point(first, end, [&](const auto& u) { return u.x() < box.low.x(); });
    const auto start = static_cast<std::size_t>(y) * static_cast<std::size_t>(camera_.width);
    for (const auto* u = from; u != end && u->x() <= box.high.x(); ++u)
      visit(start + static_cast<std::size_t>(u - first), *u);
  }
}

// Pieces of one shape add up, so that the seams between them vanish; then the shape covers what is behind it.
void Renderer::draw(const Shape& shape, const Pose& T_c_w) {
  const auto outline = project(shape.outline, T_c_w);
  if (outline.empty()) return;
  const Box box = box_of(outline);
  for_each_pixel(box, [&](std::size_t i, const Eigen::Vector2f&) { coverage_[i] = 0; });
  for (const auto& piece : shape.pieces) cover(project(piece, T_c_w));
  for_each_pixel(box, [&](std::size_t i, const Eigen::Vector2f&) {
    const float c = std::min(coverage_[i], 1.0F);
    if (c > 0) intensity_[i] += c * (static_cast<float>(shape.brightness) - intensity_[i]);
  });
}

// Share of each pixel inside a convex polygon: the distance to its nearest edge, over one pixel.
void Renderer::cover(const std::vector<Vec2>& polygon) {
  if (polygon.size() < 3) return;
  double area = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i)
    area += cross(polygon[i] - polygon[0], polygon[(i + 1) % polygon.size()] - polygon[0]);
  if (std::abs(area) < 1e-9) return;
  std::vector<Eigen::Vector3f> edges;  // a x + b y + c: signed distance, positive inside
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec2 d = polygon[(i + 1) % polygon.size()] - polygon[i];
    const double length = d.norm();
    if (length < 1e-9) continue;
    const double sign = area > 0 ? 1 / length : -1 / length;
    edges.push_back(
        Vec3(-d.y() * sign, d.x() * sign, sign * (d.y() * polygon[i].x() - d.x() * polygon[i].y()))
            .cast<float>());
  }
  for_each_pixel(box_of(polygon), [&](std::size_t i, const Eigen::Vector2f& u) {
    float inside = 1;
    for (const auto& e : edges) inside = std::min(inside, 0.5F + e.x() * u.x() + e.y() * u.y() + e.z());
    if (inside > 0) coverage_[i] += inside;
  });
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
      if (pa.x() < -0.5 * width || pa.y() < -0.5 * height || pa.x() > 1.5 * width || pa.y() > 1.5 * height)
        continue;
      largest = std::max(largest, (camera_.project(b) - pa).norm());
    }
  }
  return largest;
}

}  // namespace idol
