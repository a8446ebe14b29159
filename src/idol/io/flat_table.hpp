// Tables of a FlatBuffer, checked as they are read.
#pragma once

#include <cstdint>
#include <optional>

#include "idol/io/bytes.hpp"

namespace idol {

/// A table: fields found through its list of offsets, absent ones have their default. Every offset is
/// checked; throws BadBytes where one leads outside the buffer.
class FlatTable {
 public:
  /// The root table of a buffer (without size prefix).
  static FlatTable root(Bytes buffer) { return {buffer, follow(buffer, 0)}; }

  /// A number stored in the table.
  template <class T>
  [[nodiscard]] T get(unsigned field, T missing = {}) const {
    const auto at = find(field);
    return at ? load<T>(buffer_, *at) : missing;
  }
  /// Number of elements of a vector, and where the first one is.
  struct Vector {
    std::size_t count = 0, at = 0;
  };
  /// A vector of elements of `element` bytes each; empty if missing.
  [[nodiscard]] Vector vector(unsigned field, std::size_t element) const {
    const auto at = find(field);
    if (!at) return {};
    const std::size_t start = follow(buffer_, *at);
    const auto count = load<std::uint32_t>(buffer_, start);
    if (count > (buffer_.size() - start - 4) / element) throw BadBytes{"a list is longer than its packet"};
    return {count, start + 4};
  }
  /// Element `i` of a vector of tables.
  [[nodiscard]] FlatTable element(const Vector& tables, std::size_t i) const {
    return {buffer_, follow(buffer_, tables.at + 4 * i)};
  }
  [[nodiscard]] Bytes buffer() const { return buffer_; }

 private:
  FlatTable(Bytes buffer, std::size_t at) : buffer_(buffer), at_(at) {
    const std::int64_t fields = static_cast<std::int64_t>(at) - load<std::int32_t>(buffer, at);
    if (fields < 0) throw BadBytes{"an offset leads outside its packet"};
    fields_ = static_cast<std::size_t>(fields);
    fields_size_ = load<std::uint16_t>(buffer, fields_);
  }
  static std::size_t follow(Bytes buffer, std::size_t at) {
    const std::size_t to = at + load<std::uint32_t>(buffer, at);
    if (to > buffer.size()) throw BadBytes{"an offset leads outside its packet"};
    return to;
  }
  [[nodiscard]] std::optional<std::size_t> find(unsigned field) const {
    const std::size_t entry = 4 + 2 * std::size_t{field};
    if (entry + 2 > fields_size_) return std::nullopt;
    const auto offset = load<std::uint16_t>(buffer_, fields_ + entry);
    if (offset == 0) return std::nullopt;
    return at_ + offset;
  }

  Bytes buffer_;
  std::size_t at_, fields_ = 0, fields_size_ = 0;
};

}  // namespace idol
