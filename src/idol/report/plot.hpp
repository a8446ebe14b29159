// Diagrams for print: axes with ticks that read well, units, legends, colours that colour-blind eyes tell
// apart.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "idol/report/canvas.hpp"

namespace idol {

/// Okabe and Ito's palette.
namespace ink {
inline constexpr Rgb kBlack{0, 0, 0}, kOrange{230, 159, 0}, kSky{86, 180, 233}, kGreen{0, 158, 115},
    kBlue{0, 114, 178}, kVermillion{213, 94, 0}, kPurple{204, 121, 167}, kGrey{128, 128, 128};
}  // namespace ink

/// A curve, or dots. NaN is a gap.
struct PlotCurve {
  std::string name;  ///< in the legend; of several with one name the first stands there, with none: no one
  std::vector<double> x, y;
  Pen pen;
  double dot = 0;  ///< radius of a dot at each point instead of the line [pt]
};

/// The area between two curves; where one is NaN there is none.
struct PlotBand {
  std::string name;
  std::vector<double> x, low, high;
  Ink ink;
};

/// Quartiles as a box with the median in it, whiskers from the 5th to the 95th percentile.
struct PlotBox {
  std::string name;
  double x = 0;      ///< middle
  double width = 0;  ///< in units of x
  std::vector<double> values;
  Ink ink;
};

struct Plot {
  std::string x_label = {}, y_label = {};
  std::vector<PlotBand> bands = {};
  std::vector<PlotBox> boxes = {};
  std::vector<PlotCurve> curves = {};
  std::pair<double, double> x_range = {0, 0};  ///< as equal ends: as far as the data go
  std::pair<double, double> y_range = {0, 0};
  bool y_from_zero = false;
  bool equal = false;                                        ///< a metre is as long in x as in y
  bool y_down = false;                                       ///< as in images
  std::vector<std::pair<double, std::string>> x_names = {};  ///< instead of numbers on the x axis
  bool plain = false;                                        ///< without grid
  double share = 1;                                          ///< of a column's height
};

/// Draws plots one above the other with axes in line. Plots that share an x label share its axis and range. A
/// legend that is the same in all stands once. `box` holds everything, labels included.
void draw_column(Canvas& canvas, const Box& box, const std::vector<Plot>& plots);

/// The height of a plot of equal scales that is as wide as `width` allows, labels included; `most` is the
/// limit [pt].
double equal_height(const Plot& plot, double width, double most);

}  // namespace idol
