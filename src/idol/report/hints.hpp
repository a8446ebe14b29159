// What a run's own figures say about where it was weak, in plain words.
#pragma once

#include <string>
#include <vector>

#include "idol/report/curves.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {

/// Spans of time in seconds since zero.
using Spans = std::vector<std::pair<double, double>>;

/// One sentence each, such as "Accelerometer hardly excited: scale is weak from 3.2 to 5.0 s.". `panels` are
/// those of make_panels().
std::vector<std::string> run_hints(const RunFolder& run, const std::vector<Panel>& panels, Time zero);

/// Where `holds` is true; holes up to `hole_s` are bridged, then spans shorter than `shortest_s` are dropped.
Spans spans_where(const std::vector<double>& t, const std::vector<bool>& holds, double hole_s,
                  double shortest_s);

/// "from 3.2 to 5.0 s, 7.0 to 7.5 s and 4 more times".
std::string describe(const Spans& spans);

}  // namespace idol
