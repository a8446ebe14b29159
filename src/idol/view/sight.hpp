// What there is to see of a window, for all who show it.
#pragma once

#include <vector>

#include "idol/odometry/odometry.hpp"
#include "idol/report/picture.hpp"

namespace idol {

struct Sight {
  Time t = 0;                        ///< the window's middle
  Pose T_w_c;                        ///< of the camera, then
  std::vector<PictureEvent> events;  ///< those around it: picture_events()
  std::vector<Line> lines;           ///< mapped lines that the window saw
};

Sight sight_of(const Estimate& estimate, const UndistortMap& undistort);

}  // namespace idol
