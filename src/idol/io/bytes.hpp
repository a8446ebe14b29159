// Little-endian values in memory, checked: nothing is read beyond the end.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string_view>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol {

static_assert(std::endian::native == std::endian::little, "the binary formats are little-endian");

using Bytes = std::span<const std::uint8_t>;

/// The bytes end before the value does, or an offset in them leads outside. Caught by the reader, which knows
/// where they come from.
struct BadBytes {
  const char* why;
};

/// What is whole, but of a kind that is not read: the message says of which kind, and what to do. The reader
/// adds where it is.
class UnknownFormat : public DataError {
  using DataError::DataError;
};

template <class T>
T load(Bytes bytes, std::size_t offset) {
  if (offset > bytes.size() || sizeof(T) > bytes.size() - offset) throw BadBytes{"it is cut off"};
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

/// Reads values one after the other. Throws BadBytes at the end.
class ByteCursor {
 public:
  explicit ByteCursor(Bytes bytes) : bytes_(bytes) {}
  template <class T>
  T get() {
    const T value = load<T>(bytes_, offset_);
    offset_ += sizeof(T);
    return value;
  }
  Bytes take(std::size_t size) {
    if (size > bytes_.size() - offset_) throw BadBytes{"it is cut off"};
    const Bytes part = bytes_.subspan(offset_, size);
    offset_ += size;
    return part;
  }
  /// A length of four bytes and as many characters.
  std::string_view text() {
    const Bytes part = take(get<std::uint32_t>());
    return {reinterpret_cast<const char*>(part.data()), part.size()};
  }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - offset_; }
  [[nodiscard]] std::size_t offset() const { return offset_; }

 private:
  Bytes bytes_;
  std::size_t offset_ = 0;
};

/// Microseconds as nanoseconds; what is beyond the range of Time becomes its end, which no stamp may be.
inline Time from_us(std::int64_t us) {
  constexpr Time kMost = std::numeric_limits<Time>::max();
  if (us > kMost / 1000) return kMost;
  if (us < -(kMost / 1000)) return -kMost;
  return us * 1000;
}

}  // namespace idol
