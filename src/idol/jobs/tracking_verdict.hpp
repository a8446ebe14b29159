// Whether a run found anything to estimate from, said in one sentence with the likely cause.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "idol/base/diagnostics.hpp"

namespace idol {

/// What a run's windows say together.
struct TrackingFacts {
  double duration_s = 0;  ///< estimated
  double moving_s = 0;    ///< of it with segments in view
  double tracked_s = 0;   ///< of it with landmarks in view
  int restarts = 0;
  std::int64_t events = 0, noise = 0;  ///< of them hot or without neighbours
  double median_speed_px_s = 0;        ///< of the segments
};

/// No second of the recording was tracked, nor a quarter of the time with lines in view. Nothing is said of
/// less than a second with lines, unless there are three without.
bool nothing_tracked(const TrackingFacts& facts);

/// Says that nothing was tracked (`nothing_tracked`), that most of it was not (`poorly_tracked`) or that the
/// estimator began anew (`restarted`), and why that may be. `stages`: where the front-end lost its segments;
/// may be empty.
void report_tracking(const TrackingFacts& facts, const std::string& stages, Diagnostics& diagnostics);

}  // namespace idol
