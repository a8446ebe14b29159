// The 48 ways in which axes may be swapped and mirrored.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <vector>

#include "idol/base/lie.hpp"

namespace idol {

struct SignedAxes {
  std::array<int, 3> from{0, 1, 2};
  Vec3 sign = Vec3::Ones();

  [[nodiscard]] Vec3 apply(const Vec3& v) const {
    return {sign[0] * v[from[0]], sign[1] * v[from[1]], sign[2] * v[from[2]]};
  }
  /// For instance "(x, -z, y)".
  [[nodiscard]] std::string name() const {
    std::string text = "(";
    for (Eigen::Index i = 0; i < 3; ++i) {
      if (i > 0) text += ", ";
      if (sign[i] < 0) text += '-';
      text += "xyz"[from[static_cast<std::size_t>(i)]];
    }
    return text + ")";
  }
};

/// As they are comes first.
inline std::vector<SignedAxes> all_signed_axes() {
  std::vector<SignedAxes> all;
  std::array<int, 3> order{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs)
      all.push_back(
          {order, Vec3((signs & 1) != 0 ? -1 : 1, (signs & 2) != 0 ? -1 : 1, (signs & 4) != 0 ? -1 : 1)});
  } while (std::next_permutation(order.begin(), order.end()));
  return all;
}

}  // namespace idol
