#include "idol/report/picture_events.hpp"

#include <cmath>

namespace idol {

std::vector<PictureEvent> picture_events(const EventWindow& window, const SegmentedWindow& segments,
                                         const UndistortMap& undistort, Time middle) {
  const Time half = from_seconds(1.5 * segments.c_s_per_px);
  std::vector<PictureEvent> out;
  for (std::size_t i = window.overlap; i < window.events.size(); ++i) {
    const Event& e = window.events[i];
    if (std::abs(e.t - middle) <= half) out.push_back({undistort(e.x, e.y), segments.ids[i], e.polarity});
  }
  return out;
}

}  // namespace idol
