// Order statistics of a few values.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace idol {

/// The `k`-th smallest, from 0 on; `values` must have more than `k`.
template <class T>
T nth_smallest(std::vector<T> values, std::size_t k) {
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(k);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

/// Of at least one value; the larger of the two in the middle, where there are two.
template <class T>
T median(std::vector<T> values) {
  const std::size_t middle = values.size() / 2;
  return nth_smallest(std::move(values), middle);
}

/// The value below which a share (0 to 1) of at least one value lies, rounded down.
template <class T>
T percentile(std::vector<T> values, double share) {
  const auto k = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  return nth_smallest(std::move(values), k);
}

}  // namespace idol
