// Wall time between calls.
#pragma once

#include <chrono>
#include <utility>

namespace idol {

class Stopwatch {
 public:
  /// Since the last lap, or since it was made [s].
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(last_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace idol
