#include "idol/odometry/segmented.hpp"

namespace idol {

void shift(EventWindow& window, Time by) {
  window.begin += by;
  window.end += by;
  for (Event& event : window.events) event.t += by;
}

}  // namespace idol
