// Where numbers stand along an axis.
#pragma once

#include <string>
#include <vector>

namespace idol {

/// Multiples of 1, 2 or 5 times a power of ten.
struct Ticks {
  double step = 1;
  std::vector<double> at;

  /// The number as it stands beside its tick: as many digits as the step needs.
  [[nodiscard]] std::string label(double value) const;
};

/// Those within [low, high], as near to `wanted` of them as such steps allow. Needs low < high, finite.
Ticks make_ticks(double low, double high, double wanted);

}  // namespace idol
