#include "idol/io/rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

bool is_binary(std::string_view line) {
  return std::any_of(line.begin(), line.end(),
                     [](char c) { return (static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7f; });
}

/// Python's True and False as numbers; anything else as it is.
std::string_view as_number(std::string_view token) {
  if (token == "True" || token == "true") return "1";
  return token == "False" || token == "false" ? "0" : token;
}

/// Splits the line into exactly as many columns as there is room for and reads all as numbers.
RowResult read_numbers(std::string_view line, const char* meaning, std::span<std::string_view> columns,
                       std::span<double> values) {
  if (is_blank_or_comment(line)) return {RowStatus::kNothing};
  const std::size_t count = split_columns(line, columns);
  if (is_binary(line)) return {RowStatus::kBroken, "binary data where a line of text is expected"};
  if (count != columns.size())
    return {RowStatus::kColumns,
            fmt::format("{} columns where {} are expected ({})", count, columns.size(), meaning)};
  bool finite = true;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const auto value = parse_double(as_number(columns[i]));
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

/// A whole number of units of `ns` nanoseconds; also with a fraction, as some programs write it.
std::optional<Time> parse_units(std::string_view token, std::int64_t ns) {
  if (const auto whole = parse_integer(token)) {
    if (*whole > kLargestStamp / ns || *whole < -(kLargestStamp / ns)) return std::nullopt;
    return *whole * ns;
  }
  const auto value = parse_double(token);
  const double stamp = value ? *value * static_cast<double>(ns) : NAN;
  if (!(std::abs(stamp) <= static_cast<double>(kLargestStamp))) return std::nullopt;
  return std::llround(stamp);
}

}  // namespace

RowResult EventParser::explain(std::string_view line, Event& event) const {
  std::array<std::string_view, 4> stated, columns;
  std::array<double, 4> values;
  if (RowResult result = read_numbers(line, "t x y polarity", stated, values);
      result.status != RowStatus::kGood)
    return result;
  for (std::size_t i = 0; i < columns.size(); ++i) columns[i] = stated[layout_.columns[i]];
  const double x = values[layout_.columns[1]], y = values[layout_.columns[2]],
               polarity = values[layout_.columns[3]];
  const auto t = layout_.stamp_ns == 0 ? parse_stamp(columns[0]) : parse_units(columns[0], layout_.stamp_ns);
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
  std::array<std::string_view, 8> columns;
  std::array<double, 8> v;
  const std::size_t count = split_columns(layout_.columns, {});
  if (RowResult result = read_numbers(line, layout_.columns.c_str(), std::span(columns).first(count),
                                      std::span(v).first(count));
      result.status != RowStatus::kGood)
    return result;
  const auto t = layout_.stamp_ns == 0 ? parse_stamp(columns[0]) : parse_units(columns[0], layout_.stamp_ns);
  if (!t) return bad_stamp(columns[0]);
  sample = {*t, Vec3(v[1], v[2], v[3]), Vec3(v[4], v[5], v[6])};
  if (layout_.gyro_first) std::swap(sample.accel, sample.gyro);
  return {};
}

}  // namespace idol
