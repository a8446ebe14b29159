// How far a segment's events waver about one straight line: what tells drawn lines from texture that is
// nearly straight.
#pragma once

#include <cstdint>
#include <span>

#include "idol/base/camera.hpp"
#include "idol/frontend/moving_line.hpp"
#include "idol/frontend/windower.hpp"

namespace idol {

/// RMS over a segment's events of how far the mean of their neighbours, those of one sixth of the line in one
/// quarter of the window, lies off the line [px]. The scatter of single events averages out of it, bends and
/// steps do not; events beyond a pixel, noise mostly, do not count.
/// `events`: indices of the segment's events in the window; `line`: fitted to them, its time in s since the
/// window's begin.
double waviness(const EventWindow& window, std::span<const std::uint32_t> events, const MovingLine& line,
                const UndistortMap& undistort);

}  // namespace idol
