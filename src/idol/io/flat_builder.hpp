// FlatBuffers written front to back, behind their size: a table comes before what it points to.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <string_view>
#include <vector>

namespace idol {

class FlatBuilder {
 public:
  /// One field of a table: its number and its size in bytes. Offsets to vectors and tables have four.
  struct Field {
    unsigned number = 0, size = 0;
  };

  /// Place of the offset that leads to the root table.
  static constexpr std::size_t kRoot = 4;

  /// A buffer of the type `kind` (four characters).
  explicit FlatBuilder(std::string_view kind) : bytes_(kRoot + 4 + kind.size()) {
    std::copy(kind.begin(), kind.end(), bytes_.begin() + kRoot + 4);
  }
  /// Begins a table, its fields all zero; `pointer` is the place of the offset that leads to it. Returns the
  /// places of the fields, in the order given.
  std::vector<std::size_t> table(std::size_t pointer, std::initializer_list<Field> fields) {
    unsigned most = 0;
    for (const Field& field : fields) most = field.number > most ? field.number : most;
    align(8);
    // The list of offsets, then the table, which begins with the way back to the list.
    const std::size_t list = bytes_.size();
    bytes_.resize(list + 4 + 2 * (most + 1));
    align(8);
    const std::size_t begin = bytes_.size();
    put<std::int32_t>(static_cast<std::int32_t>(begin - list));
    std::vector<std::size_t> places;
    for (const Field& field : fields) {
      align(field.size);
      places.push_back(bytes_.size());
      set(list + 4 + 2 * std::size_t{field.number}, static_cast<std::uint16_t>(bytes_.size() - begin));
      bytes_.resize(bytes_.size() + field.size);
    }
    set(list, static_cast<std::uint16_t>(4 + 2 * (most + 1)));
    set(list + 2, static_cast<std::uint16_t>(bytes_.size() - begin));
    point(pointer, begin);
    return places;
  }
  /// Begins a vector of `count` elements of `size` bytes, all zero; returns the place of the first one.
  std::size_t vector(std::size_t pointer, std::size_t count, std::size_t size) {
    // The elements, which the count stands before, lie on multiples of eight.
    while (bytes_.size() % 8 != 4) bytes_.push_back(0);
    point(pointer, bytes_.size());
    put(static_cast<std::uint32_t>(count));
    const std::size_t first = bytes_.size();
    bytes_.resize(first + count * size);
    return first;
  }
  template <class T>
  void set(std::size_t place, T value) {
    std::memcpy(bytes_.data() + place, &value, sizeof(T));
  }
  /// Size and buffer.
  const std::vector<std::uint8_t>& finish() {
    set(0, static_cast<std::uint32_t>(bytes_.size() - kRoot));
    return bytes_;
  }

 private:
  void align(std::size_t size) {
    while (bytes_.size() % size != 0) bytes_.push_back(0);
  }
  void point(std::size_t from, std::size_t to) { set(from, static_cast<std::uint32_t>(to - from)); }
  template <class T>
  void put(T value) {
    bytes_.resize(bytes_.size() + sizeof(T));
    set(bytes_.size() - sizeof(T), value);
  }

  std::vector<std::uint8_t> bytes_;
};

}  // namespace idol
