#include "idol/report/ticks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace idol {

std::string Ticks::label(double value) const {
  const int digits = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  const double size = std::abs(value) < 1e-6 * step ? 0 : std::abs(value);  // no "-0"
  const char* sign = size > 0 && value < 0 ? "\u2212" : "";
  if (digits > 5 || size >= 1e6) return fmt::format("{}{:.3g}", sign, size);
  return fmt::format("{}{:.{}f}", sign, size, digits);
}

Ticks make_ticks(double low, double high, double wanted) {
  const double rough = (high - low) / std::max(wanted, 1.0);
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  // The geometric means of neighbours part them: whichever is nearest by ratio.
  const double share = rough / power;
  Ticks ticks{.step = power * (share < std::sqrt(2.0)    ? 1
                               : share < std::sqrt(10.0) ? 2
                               : share < std::sqrt(50.0) ? 5
                                                         : 10),
              .at = {}};
  constexpr double kSlack = 1e-9;  // an end that is a multiple itself belongs to it
  const double first = std::ceil(low / ticks.step - kSlack), last = std::floor(high / ticks.step + kSlack);
  for (double k = first; k <= last; ++k) ticks.at.push_back(k * ticks.step);
  return ticks;
}

}  // namespace idol
