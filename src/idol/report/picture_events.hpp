#pragma once

#include <vector>

#include "idol/base/camera.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/report/picture.hpp"

namespace idol {

/// The window's own events of about three pixels of motion around `middle`: a sharp picture.
std::vector<PictureEvent> picture_events(const EventWindow& window, const SegmentedWindow& segments,
                                         const UndistortMap& undistort, Time middle);

}  // namespace idol
