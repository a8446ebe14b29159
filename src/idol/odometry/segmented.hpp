// A window between the front-end and the back-end.
#pragma once

#include <vector>

#include "idol/base/types.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"

namespace idol {

/// A window as the front-end leaves it.
struct Segmented {
  EventWindow window;
  SegmentedWindow segments;
  std::vector<ImuSample> samples;  ///< of the window's time and a margin
  double segment_s = 0;            ///< wall time of the front-end
  SegmenterCounts counts;          ///< of all events up to this window
};

/// Moves the window and its events in time; the lines go with it, as their times count from its begin. Its
/// IMU samples are to be taken anew.
void shift(EventWindow& window, Time by);

}  // namespace idol
