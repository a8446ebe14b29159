// Numbers in text, whatever the locale: stamps exactly to the nanosecond, the rest to the nearest double.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "idol/base/input_check.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Columns may be parted by any run of blanks, tabs and commas.
inline bool is_separator(char c) { return c == ' ' || c == '\t' || c == ','; }

/// Splits a line into columns. Returns how many there are; those beyond `columns.size()` are only counted.
std::size_t split_columns(std::string_view line, std::span<std::string_view> columns);

/// True for a blank line or a comment ('#', or Metavision's '%').
bool is_blank_or_comment(std::string_view line);

/// A whole token as a number, NaN and infinities included; nullopt if it is not one.
std::optional<double> parse_double(std::string_view token);

/// A whole token as an integer; nullopt if it is not one.
std::optional<std::int64_t> parse_integer(std::string_view token);

/// Decimal seconds as nanoseconds, exactly, halves of a nanosecond away from zero; any number of digits,
/// scientific notation too. nullopt if it is no finite number or beyond
/// kLargestStamp.
std::optional<Time> parse_stamp(std::string_view token);

inline bool is_digit(char c) { return static_cast<unsigned char>(c - '0') < 10; }

/// The common shape of a stamp, [-]digits[.digits], read from `p` on. Returns the first character behind it,
/// or nullptr if it has another shape (then see parse_stamp).
inline const char* parse_plain_stamp(const char* p, const char* end, Time& t) {
  constexpr std::int64_t kScale[] = {1'000'000'000, 100'000'000, 10'000'000, 1'000'000, 100'000,
                                     10'000,        1'000,       100,        10,        1};
  const bool negative = p != end && *p == '-';
  if (negative) ++p;
  const char* start = p;
  std::int64_t seconds = 0;
  for (; p != end && is_digit(*p) && p - start < 11; ++p) seconds = seconds * 10 + (*p - '0');
  if (p == start || seconds >= kLargestStamp / 1'000'000'000) return nullptr;
  std::int64_t fraction = 0;
  if (p != end && *p == '.') {
    start = ++p;
    for (; p != end && is_digit(*p) && p - start < 9; ++p) fraction = fraction * 10 + (*p - '0');
    fraction *= kScale[p - start];
    if (p != end && is_digit(*p)) {
      if (*p >= '5') ++fraction;
      while (p != end && is_digit(*p)) ++p;
    }
  }
  t = seconds * 1'000'000'000 + fraction;
  if (negative) t = -t;
  return p;
}

}  // namespace idol
