// Holds labelled windows back for a while, so that events of a line get its id from its birth on: a track is
// known to be a line only after it has moved.
#pragma once

#include <deque>
#include <optional>

#include "idol/frontend/segments.hpp"

namespace idol {

struct LabelledWindow {
  EventWindow window;
  SegmentedWindow segments;
};

class DelayedLabels {
 public:
  /// A window is held for at most so long after its end [s].
  explicit DelayedLabels(double longest_s = 1) : longest_s_(longest_s) {}

  /// The next window. Tentative segments of those held whose tracks have turned out to be lines go to their
  /// segments, and their events get the id.
  void add(EventWindow window, SegmentedWindow segments);
  /// The oldest window held, once nothing can change in it any more.
  std::optional<LabelledWindow> pop();
  /// The oldest window held, at the end of the recording.
  std::optional<LabelledWindow> flush();

 private:
  double longest_s_;
  std::deque<LabelledWindow> held_;
};

}  // namespace idol
