// The size of a sensor that no calibration describes, from its events.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

class SizeSeen {
 public:
  struct Size {
    int width = 0, height = 0;
  };

  void add(std::span<const Event> events);
  [[nodiscard]] bool empty() const { return count_ == 0; }
  /// The smallest that holds all pixels but a few (2, or 0.1 %) that lie at more than twice the distance of
  /// all others: those are damage. Throws DataError, naming `recording`, for more than 4096 pixels on a side.
  [[nodiscard]] Size size(const std::string& recording) const;

 private:
  using Counts = std::vector<std::int64_t>;
  [[nodiscard]] int side(const Counts& counts) const;

  std::int64_t count_ = 0;
  Counts x_ = Counts(1 << 16), y_ = Counts(1 << 16);
};

}  // namespace idol
