// The figures one by one. Internal to report/; the door is figures.hpp.
#pragma once

#include <string>
#include <vector>

#include "idol/report/curves.hpp"
#include "idol/report/plot.hpp"

namespace idol {

/// What all figures draw from.
struct FigureSource {
  RunFolder run;
  Time zero = 0;  ///< of all time axes
  AlignedTruth truth, causal_truth;
  std::vector<Panel> panels;  ///< of make_panels
};

/// Plots one above the other; or, without any, what they would need.
struct Figure {
  std::vector<Plot> plots;
  double height = 0;  ///< [pt]
  std::string needs = {};
};

using FigureMaker = Figure (*)(const FigureSource& source, double width);

// Against time.
Figure position_figure(const FigureSource& source, double width);
Figure orientation_figure(const FigureSource& source, double width);
Figure velocity_figure(const FigureSource& source, double width);
Figure bias_figure(const FigureSource& source, double width);
Figure error_figure(const FigureSource& source, double width);
Figure consistency_figure(const FigureSource& source, double width);
Figure health_figure(const FigureSource& source, double width);

// In space and in the image, and statistics.
Figure trajectory_figure(const FigureSource& source, double width);
Figure map_figure(const FigureSource& source, double width);
Figure event_figure(const FigureSource& source, double width);
Figure segment_figure(const FigureSource& source, double width);

}  // namespace idol
