#include "idol/view/sight.hpp"

#include "idol/report/picture_events.hpp"

namespace idol {

Sight sight_of(const Estimate& e, const UndistortMap& undistort) {
  Sight sight;
  sight.t = (e.window.begin + e.window.end) / 2;
  sight.T_w_c = e.smoother.camera_pose(e.smoother.state_at(sight.t)).T;
  sight.events = picture_events(e.window, e.segments, undistort, sight.t);
  sight.lines = e.smoother.lines();
  std::erase_if(sight.lines, [&](const Line& line) { return line.last < e.window.end; });
  return sight;
}

}  // namespace idol
