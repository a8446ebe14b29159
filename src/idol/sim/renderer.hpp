// Brightness of every pixel of a camera in a scene, with edges averaged over the pixel's area.
#pragma once

#include <vector>

#include "idol/base/camera.hpp"
#include "idol/sim/scene.hpp"

namespace idol {

class Renderer {
 public:
  Renderer(const Scene& scene, const Camera& camera);

  /// Linear intensity of each pixel, row by row, seen from a camera pose.
  [[nodiscard]] const std::vector<float>& render(const Pose& T_w_c);
  /// Largest image motion of any visible shape's corner between two camera poses [px].
  [[nodiscard]] double motion_px(const Pose& from, const Pose& to) const;

 private:
  struct Box {  // of undistorted positions
    Vec2 low, high;
  };
  struct Row {  // undistorted y of one row of pixels
    float low, high;
  };

  void draw(const Shape& shape, const Pose& T_c_w);
  void cover(const std::vector<Vec2>& polygon);
  [[nodiscard]] static Box box_of(const std::vector<Vec2>& polygon);
  template <class Visit>
  void for_each_pixel(const Box& box, Visit&& visit) const;
  [[nodiscard]] std::vector<Vec2> project(const std::vector<Vec3>& polygon, const Pose& T_c_w) const;

  Scene scene_;
  Camera camera_;
  UndistortMap undistort_;
  std::vector<float> intensity_;
  std::vector<float> coverage_;  // of the shape being drawn
  std::vector<Row> rows_;
};

}  // namespace idol
