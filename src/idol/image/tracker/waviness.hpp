// How far a segment's events waver about one straight line: what tells drawn lines from texture that is
// nearly straight.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>

#include "idol/base/camera.hpp"
#include "idol/frontend/moving_line.hpp"
#include "idol/frontend/windower.hpp"

namespace idol {

/// How far a segment's events waver about its line: the mean square of the distances of pieces of it, those
/// of one sixth of the line in one quarter of the window, without what the scatter of single events makes of
/// it by chance. Below zero by chance where the line is straight: sums over windows are unbiased.
struct Waviness {
  double squares = 0;  ///< [px^2], times `events`
  double events = 0;

  [[nodiscard]] double rms_px() const { return events > 0 && squares > 0 ? std::sqrt(squares / events) : 0; }
};

/// `events`: indices of the segment's events in the window; `line`: fitted to them, its time in s since the
/// window's begin; `near`: events farther from it are noise [px].
Waviness waviness(const EventWindow& window, std::span<const std::uint32_t> events, const MovingLine& line,
                  double near, const UndistortMap& undistort);

}  // namespace idol
