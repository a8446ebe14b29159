// Small tables of numbers in text: every row must be whole, of known width and finite.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "idol/base/types.hpp"

namespace idol {

/// One row of a table, with its place for messages.
class TableRow {
 public:
  TableRow(std::span<const std::string_view> columns, std::string where)
      : columns_(columns), where_(std::move(where)) {}
  /// Column `i` as a finite number, a stamp, an integer. Each throws DataError, naming file and line.
  [[nodiscard]] double number(std::size_t i) const;
  /// A number that need not be finite.
  [[nodiscard]] double any_number(std::size_t i) const;
  [[nodiscard]] Time stamp(std::size_t i) const;
  [[nodiscard]] std::int64_t integer(std::size_t i) const;
  [[nodiscard]] Vec3 vec3(std::size_t i) const { return {number(i), number(i + 1), number(i + 2)}; }
  /// Throws DataError with the row's place before the message.
  [[noreturn]] void refuse(const std::string& why) const;

 private:
  std::span<const std::string_view> columns_;
  std::string where_;
};

/// Calls `take` for each row. `header` names the columns, parted by commas or blanks; a first line equal to
/// it is skipped, as are comments and blank lines. Throws DataError with file and line for rows of another
/// width.
void read_table(const std::filesystem::path& path, const std::string& header,
                const std::function<void(const TableRow&)>& take);

}  // namespace idol
