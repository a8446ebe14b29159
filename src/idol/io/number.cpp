#include "idol/io/number.hpp"

#include <charconv>
#include <cmath>
#include <limits>
#include <string>

namespace idol {
namespace {

std::string_view without_plus(std::string_view token) {
  if (token.size() > 1 && token[0] == '+' && token[1] != '-') token.remove_prefix(1);
  return token;
}

/// Digits of a decimal number without point and leading zeros, and the power of ten of the first one.
struct Decimal {
  std::string digits;
  std::int64_t exponent = 0;  // value = 0.digits * 10^exponent
};

std::optional<Decimal> parse_decimal(std::string_view token) {
  Decimal decimal;
  bool any = false;
  bool point = false;
  std::size_t i = 0;
  for (; i < token.size(); ++i) {
    const char c = token[i];
    if (c == '.' && !point) {
      point = true;
    } else if (is_digit(c)) {
      any = true;
      const bool leading_zero = c == '0' && decimal.digits.empty();
      if (!leading_zero) decimal.digits += c;
      if (point && leading_zero) --decimal.exponent;
      if (!point && !leading_zero) ++decimal.exponent;
    } else {
      break;
    }
  }
  if (!any) return std::nullopt;
  if (i == token.size()) return decimal;
  if (token[i] != 'e' && token[i] != 'E') return std::nullopt;
  const auto exponent = parse_integer(token.substr(i + 1));
  constexpr std::int64_t kLargestExponent = 100000;
  if (!exponent || std::abs(*exponent) > kLargestExponent) return std::nullopt;
  decimal.exponent += *exponent;
  return decimal;
}

}  // namespace

std::size_t split_columns(std::string_view line, std::span<std::string_view> columns) {
  std::size_t count = 0;
  std::size_t i = 0;
  while (true) {
    while (i < line.size() && is_separator(line[i])) ++i;
    if (i == line.size()) return count;
    const std::size_t start = i;
    while (i < line.size() && !is_separator(line[i])) ++i;
    if (count < columns.size()) columns[count] = line.substr(start, i - start);
    ++count;
  }
}

bool is_blank_or_comment(std::string_view line) {
  const std::size_t first = line.find_first_not_of(" \t,");
  return first == std::string_view::npos || line[first] == '#' || line[first] == '%';
}

std::optional<double> parse_double(std::string_view token) {
  token = without_plus(token);
  double value = 0;
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (end != token.data() + token.size() || error == std::errc::invalid_argument) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    // Too small is zero; too large is as useless as an infinity.
    const auto decimal = parse_decimal(token[0] == '-' ? token.substr(1) : token);
    return decimal && decimal->exponent < 0 ? 0.0 : std::numeric_limits<double>::infinity();
  }
  return value;
}

std::optional<std::int64_t> parse_integer(std::string_view token) {
  token = without_plus(token);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (end != token.data() + token.size() || error != std::errc()) return std::nullopt;
  return value;
}

std::optional<Time> parse_stamp(std::string_view token) {
  Time t = 0;
  const char* end = token.data() + token.size();
  if (parse_plain_stamp(token.data(), end, t) == end && !token.empty()) return t;

  token = without_plus(token);
  const bool negative = token.starts_with('-');
  const auto decimal = parse_decimal(negative ? token.substr(1) : token);
  if (!decimal) return std::nullopt;
  const auto digit = [&](std::int64_t i) {
    return i >= 0 && i < std::ssize(decimal->digits) ? decimal->digits[static_cast<std::size_t>(i)] - '0' : 0;
  };
  if (decimal->digits.empty()) return Time{0};
  const std::int64_t places = decimal->exponent + 9;  // leading digits that make whole nanoseconds
  constexpr std::int64_t kMostPlaces = 19;            // those of the largest Time, 9.2e18 ns
  if (places > kMostPlaces) return std::nullopt;
  std::uint64_t nanoseconds = 0;
  for (std::int64_t i = 0; i < places; ++i)
    nanoseconds = nanoseconds * 10 + static_cast<std::uint64_t>(digit(i));
  if (places >= 0 && digit(places) >= 5) ++nanoseconds;
  if (nanoseconds > static_cast<std::uint64_t>(kLargestStamp)) return std::nullopt;
  t = static_cast<Time>(nanoseconds);
  return negative ? -t : t;
}

}  // namespace idol
