// What a simulated camera looks at: flat polygons of uniform brightness before a uniform background.
#pragma once

#include <filesystem>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// A planar polygon, cut into convex pieces for drawing. Later shapes cover earlier ones.
struct Shape {
  std::vector<Vec3> outline;              ///< in the world [m]
  std::vector<std::vector<Vec3>> pieces;  ///< triangles that tile it
  double brightness = 0.1;                ///< linear intensity in (0, 1]
  bool curved = false;                    ///< stands for a smooth curve: its edges are no lines
};

struct Scene {
  double background = 0.8;
  Vec3 eye = Vec3::Zero();      ///< where the camera starts
  Vec3 target = Vec3(1, 0, 0);  ///< what it looks at then
  std::vector<Shape> shapes;
};

/// Reads a scene (docs/simulator.md). Throws DataError with file and line.
Scene load_scene(const std::filesystem::path& path);

/// A shape from its outline (at least three points of one plane, not self-crossing). Throws DataError
/// otherwise.
Shape make_shape(std::vector<Vec3> outline, double brightness, bool curved = false);

/// Start of the camera: z towards the target, x to the right, y down.
Pose starting_camera(const Scene& scene);

}  // namespace idol
