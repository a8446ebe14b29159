#include "idol/io/rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

bool is_binary(std::string_view line) {
  return std::any_of(line.begin(), line.end(),
                     [](char c) { return (static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7f; });
}

/// Splits the line into exactly N columns and reads all as numbers.
template <std::size_t N>
RowResult read_numbers(std::string_view line, const char* meaning, std::array<std::string_view, N>& columns,
                       std::array<double, N>& values) {
  if (is_blank_or_comment(line)) return {RowStatus::kNothing};
  const std::size_t count = split_columns(line, columns);
  if (is_binary(line)) return {RowStatus::kBroken, "binary data where a line of text is expected"};
  if (count != N)
    return {RowStatus::kColumns, fmt::format("{} columns where {} are expected ({})", count, N, meaning)};
  bool finite = true;
  for (std::size_t i = 0; i < N; ++i) {
    const auto value = parse_double(columns[i]);
    if (!value)
      return {RowStatus::kBroken, fmt::format("'{}' is not a number ({})", printable(columns[i]), meaning)};
    values[i] = *value;
    finite = finite && std::isfinite(*value);
  }
  if (!finite) return {RowStatus::kNotFinite, "a value is not finite"};
  return {};
}

RowResult bad_stamp(std::string_view token) {
  return {
      RowStatus::kBroken,
      fmt::format("'{}' cannot be a stamp in seconds; are these micro- or nanoseconds?", printable(token))};
}

}  // namespace

RowResult EventParser::explain(std::string_view line, Event& event) const {
  std::array<std::string_view, 4> columns;
  std::array<double, 4> values;
  if (RowResult result = read_numbers(line, "t x y polarity", columns, values);
      result.status != RowStatus::kGood)
    return result;
  const auto [seconds, x, y, polarity] = values;
  const auto t = parse_stamp(columns[0]);
  if (!t) return bad_stamp(columns[0]);
  if (x != std::floor(x) || y != std::floor(y)) {
    return {RowStatus::kBroken,
            fmt::format("pixel ({}, {}) is not whole: events must be raw, not undistorted",
                        printable(columns[1]), printable(columns[2]))};
  }
  if (polarity != 0 && polarity != 1 && polarity != -1)
    return {RowStatus::kBroken, fmt::format("polarity '{}' is none of 0, 1, -1", printable(columns[3]))};
  if (!(x >= 0 && x <= kLargestPixel && y >= 0 && y <= kLargestPixel))
    return {RowStatus::kOutside, fmt::format("pixel ({}, {}) lies outside any sensor", x, y)};
  event = {*t, static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), polarity > 0};
  return {};
}

RowResult ImuParser::explain(std::string_view line, ImuSample& sample) const {
  std::array<std::string_view, 7> columns;
  std::array<double, 7> v;
  if (RowResult result = read_numbers(line, "t ax ay az gx gy gz", columns, v);
      result.status != RowStatus::kGood)
    return result;
  const auto t = parse_stamp(columns[0]);
  if (!t) return bad_stamp(columns[0]);
  sample = {*t, Vec3(v[1], v[2], v[3]), Vec3(v[4], v[5], v[6])};
  return {};
}

}  // namespace idol
