#include "idol/io/table.hpp"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"

namespace idol {

void TableRow::refuse(const std::string& why) const { throw DataError(fmt::format("{}: {}", where_, why)); }

double TableRow::number(std::size_t i) const {
  const auto value = parse_double(columns_[i]);
  if (!value || !std::isfinite(*value))
    refuse(fmt::format("'{}' is not a finite number", printable(columns_[i])));
  return *value;
}

double TableRow::any_number(std::size_t i) const {
  const auto value = parse_double(columns_[i]);
  if (!value) refuse(fmt::format("'{}' is not a number", printable(columns_[i])));
  return *value;
}

Time TableRow::stamp(std::size_t i) const {
  const auto value = parse_stamp(columns_[i]);
  if (!value) refuse(fmt::format("'{}' is not a stamp in seconds", printable(columns_[i])));
  return *value;
}

std::int64_t TableRow::integer(std::size_t i) const {
  const auto value = parse_integer(columns_[i]);
  if (!value) refuse(fmt::format("'{}' is not an integer", printable(columns_[i])));
  return *value;
}

void read_table(const std::filesystem::path& path, const std::string& header,
                const std::function<void(const TableRow&)>& take) {
  const std::size_t width = split_columns(header, {});
  std::vector<std::string_view> columns(width);
  LineReader lines(path);
  std::string_view line;
  while (lines.next(line)) {
    if (is_blank_or_comment(line) || line == header) continue;
    const std::size_t count = split_columns(line, columns);
    if (count != width) {
      throw DataError(
          fmt::format("{}: {} columns where {} are expected ({})", lines.where(), count, width, header));
    }
    take(TableRow(columns, lines.where()));
  }
}

}  // namespace idol
