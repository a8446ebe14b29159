#include "idol/io/sensor_size.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "idol/base/diagnostics.hpp"

namespace idol {

void SizeSeen::add(std::span<const Event> events) {
  for (const Event& event : events) {
    ++x_[event.x];
    ++y_[event.y];
  }
  count_ += std::ssize(events);
}

int SizeSeen::side(const Counts& counts) const {
  const std::int64_t few = std::min(std::max<std::int64_t>(2, count_ / 1000), count_ / 10);
  int bulk = static_cast<int>(counts.size()) - 1;  // the largest but for the few
  for (std::int64_t beyond = 0; bulk > 0 && beyond + counts[static_cast<std::size_t>(bulk)] <= few; --bulk)
    beyond += counts[static_cast<std::size_t>(bulk)];
  int largest = std::min(2 * bulk + 1, static_cast<int>(counts.size()) - 1);
  while (largest > 0 && counts[static_cast<std::size_t>(largest)] == 0) --largest;
  return largest + 1;
}

SizeSeen::Size SizeSeen::size(const std::string& recording) const {
  constexpr int kLargest = 4096;
  const Size size{side(x_), side(y_)};
  if (size.width > kLargest || size.height > kLargest)
    throw DataError(
        fmt::format("{}: pixels up to ({}, {}): no event camera is that large; are the columns 't x y "
                    "polarity'?",
                    recording, size.width - 1, size.height - 1));
  return size;
}

}  // namespace idol
