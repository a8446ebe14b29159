#include "idol/sim/scene.hpp"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <numbers>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

// Area vector of a closed outline: along its normal, as long as its area.
Vec3 area_vector(const std::vector<Vec3>& outline) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 0; i < outline.size(); ++i)
    sum += 0.5 * (outline[i] - outline[0]).cross(outline[(i + 1) % outline.size()] - outline[0]);
  return sum;
}

bool in_triangle(const Vec2& p, const Vec2& a, const Vec2& b, const Vec2& c) {
  return cross(b - a, p - a) >= 0 && cross(c - b, p - b) >= 0 && cross(a - c, p - c) >= 0;
}

// Ear clipping.
std::vector<std::vector<Vec3>> triangulate(const std::vector<Vec3>& outline, const Vec3& normal) {
  const Vec3 ex = (outline[1] - outline[0]).normalized(), ey = normal.cross(ex);
  std::vector<Vec2> flat;
  for (const auto& p : outline) flat.emplace_back(ex.dot(p - outline[0]), ey.dot(p - outline[0]));
  std::vector<std::size_t> left(outline.size());
  for (std::size_t i = 0; i < left.size(); ++i) left[i] = i;
  std::vector<std::vector<Vec3>> triangles;
  while (left.size() >= 3) {
    bool cut = false;
    for (std::size_t k = 0; k < left.size() && !cut; ++k) {
      const std::size_t a = left[(k + left.size() - 1) % left.size()], b = left[k],
                        c = left[(k + 1) % left.size()];
      if (cross(flat[b] - flat[a], flat[c] - flat[b]) <= 0) continue;
      bool empty = true;
      for (std::size_t other : left)
        if (other != a && other != b && other != c && in_triangle(flat[other], flat[a], flat[b], flat[c]))
          empty = false;
      if (!empty) continue;
      triangles.push_back({outline[a], outline[b], outline[c]});
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(k));
      cut = true;
    }
    if (!cut) throw DataError("a polygon crosses itself");
  }
  return triangles;
}

[[noreturn]] void fail(const YAML::Node& node, const std::string& file, const std::string& what) {
  throw DataError(fmt::format("{}:{}: {}", file, node.Mark().line + 1, what));
}

Vec3 read_point(const YAML::Node& node, const std::string& file) {
  if (!node.IsSequence() || node.size() != 3) fail(node, file, "expected a point [x, y, z]");
  Vec3 out;
  for (int i = 0; i < 3; ++i) out[i] = node[static_cast<std::size_t>(i)].as<double>();
  return out;
}

double read_number(const YAML::Node& parent, const char* key, double fallback) {
  return parent[key] ? parent[key].as<double>() : fallback;
}

// Points on an ellipse or a star about a centre, in the plane of `right` and `up` (half axes).
std::vector<Vec3> round_outline(const YAML::Node& node, const std::string& file, int points, double inner) {
  for (const char* key : {"center", "right", "up"})
    if (!node[key]) fail(node, file, fmt::format("'{}' is missing", key));
  const Vec3 centre = read_point(node["center"], file);
  const Vec3 right = read_point(node["right"], file), up = read_point(node["up"], file);
  std::vector<Vec3> out;
  for (int k = 0; k < points; ++k) {
    const double angle = 2 * std::numbers::pi * k / points, radius = k % 2 == 0 ? 1 : inner;
    out.emplace_back(centre + radius * (std::cos(angle) * right + std::sin(angle) * up));
  }
  return out;
}

std::vector<Vec3> rectangle(const YAML::Node& node, const std::string& file) {
  for (const char* key : {"corner", "right", "up"})
    if (!node[key]) fail(node, file, fmt::format("'{}' is missing", key));
  const Vec3 corner = read_point(node["corner"], file);
  const Vec3 right = read_point(node["right"], file), up = read_point(node["up"], file);
  return {corner, corner + right, corner + right + up, corner + up};
}

// A line drawn with a width on a surface.
std::vector<Vec3> stroke(const YAML::Node& node, const std::string& file) {
  for (const char* key : {"a", "b", "normal"})
    if (!node[key]) fail(node, file, fmt::format("'{}' is missing", key));
  const Vec3 a = read_point(node["a"], file), b = read_point(node["b"], file);
  const Vec3 side =
      0.5 * read_number(node, "width", 0.01) * read_point(node["normal"], file).cross(b - a).normalized();
  return {a - side, b - side, b + side, a + side};
}

Shape read_shape(const YAML::Node& node, const std::string& file) {
  std::vector<Vec3> outline;
  bool curved = false;
  if (const auto polygon = node["polygon"]) {
    for (const auto& p : polygon) outline.push_back(read_point(p, file));
  } else if (node["rectangle"]) {
    outline = rectangle(node["rectangle"], file);
  } else if (node["line"]) {
    outline = stroke(node["line"], file);
  } else if (node["ellipse"]) {
    outline = round_outline(node["ellipse"], file, 48, 1.0);
    curved = true;
  } else if (node["star"]) {
    outline = round_outline(node["star"], file, 10, 0.45);
  } else {
    fail(node, file, "a shape is one of polygon, rectangle, line, ellipse, star");
  }
  const double brightness = read_number(node, "brightness", 0.1);
  if (!(brightness > 0 && brightness <= 1)) fail(node, file, "brightness must lie in (0, 1]");
  return make_shape(std::move(outline), brightness, curved);
}

}  // namespace

Shape make_shape(std::vector<Vec3> outline, double brightness, bool curved) {
  if (outline.size() < 3) throw DataError("a polygon needs at least three points");
  const Vec3 area = area_vector(outline);
  if (!(area.norm() > 1e-9)) throw DataError("a polygon has no area");
  const Vec3 normal = area.normalized();
  for (const auto& p : outline)
    if (std::abs(normal.dot(p - outline[0])) > 1e-3)
      throw DataError("the points of a polygon are not in one plane");
  Shape shape;
  shape.pieces = triangulate(outline, normal);
  shape.outline = std::move(outline);
  shape.brightness = brightness;
  shape.curved = curved;
  return shape;
}

Scene load_scene(const std::filesystem::path& path) {
  const std::string file = path.string();
  try {
    const YAML::Node root = YAML::LoadFile(file);
    if (!root.IsMap() || !root["shapes"])
      throw DataError(fmt::format("{}:1: no 'shapes' in the scene", file));
    Scene scene;
    scene.background = read_number(root, "background", scene.background);
    if (!(scene.background > 0 && scene.background <= 1))
      fail(root["background"], file, "must lie in (0, 1]");
    if (root["eye"]) scene.eye = read_point(root["eye"], file);
    if (root["target"]) scene.target = read_point(root["target"], file);
    for (const auto& node : root["shapes"]) {
      try {
        scene.shapes.push_back(read_shape(node, file));
      } catch (const DataError& e) {
        const std::string what = e.what();
        if (what.rfind(file, 0) == 0) throw;
        fail(node, file, what);
      }
    }
    return scene;
  } catch (const YAML::BadFile&) {
    throw DataError(fmt::format("{}: cannot be read", file));
  } catch (const YAML::Exception& e) {
    throw DataError(fmt::format("{}:{}: {}", file, e.mark.line + 1, e.msg));
  }
}

Pose starting_camera(const Scene& scene) {
  Mat3 R_w_c;
  R_w_c.col(2) = (scene.target - scene.eye).normalized();
  R_w_c.col(0) = R_w_c.col(2).cross(Vec3::UnitZ()).normalized();
  R_w_c.col(1) = R_w_c.col(2).cross(R_w_c.col(0));
  return {Quat(R_w_c).normalized(), scene.eye};
}

}  // namespace idol
