#include "idol/io/text_layout.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <optional>
#include <string_view>
#include <vector>

#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"

namespace idol {
namespace {

constexpr std::int64_t kUnits[] = {1, 1'000, 1'000'000, 1'000'000'000};
constexpr std::size_t kMostRows = 5000;

std::vector<std::string_view> columns_of(std::string_view line) {
  std::vector<std::string_view> columns(split_columns(line, {}));
  split_columns(line, columns);
  return columns;
}

/// Names of columns: letters first, and nothing that is no text.
bool is_name(std::string_view token) {
  const auto printed = [](char c) { return std::isgraph(static_cast<unsigned char>(c)) != 0; };
  return std::isalpha(static_cast<unsigned char>(token[0])) != 0 &&
         std::all_of(token.begin(), token.end(), printed);
}

std::string lower(std::string_view token) {
  std::string text(token);
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

/// The first rows of a file as columns, copied, without comments.
struct Beginning {
  std::vector<std::vector<std::string>> rows;
  std::vector<std::string> comments;

  explicit Beginning(const std::filesystem::path& path) {
    LineReader lines(path);
    std::string_view line;
    try {
      while (rows.size() < kMostRows && lines.next(line)) {
        if (is_blank_or_comment(line)) {
          if (comments.size() < 100) comments.emplace_back(line);
          continue;
        }
        const auto columns = columns_of(line);
        rows.emplace_back(columns.begin(), columns.end());
        if (rows.back().size() > 32) break;  // no table
      }
    } catch (const DataError&) {
      // The pass that matters comes to the same place, and says so.
    }
  }
};

/// Which of t, x, y and polarity a name is of; -1: none.
int column_named(std::string_view token) {
  const std::string name = lower(token);
  if (name == "x" || name == "y") return name == "x" ? 1 : 2;
  if (name == "p" || name.starts_with("pol")) return 3;
  return name.starts_with("t") ? 0 : -1;
}

std::int64_t unit_in_name(std::string_view name) {
  for (const std::int64_t ns : kUnits)
    for (const char* form : {"[{}]", "({})", "_{}"})
      if (lower(name).ends_with(fmt::format(fmt::runtime(form), unit_name(ns)))) return ns;
  return 0;
}

bool whole(std::string_view token) {
  const auto value = parse_double(token);
  return value && *value == std::floor(*value);
}

/// Mean distance of stamps that are whole numbers; nothing if they are not, or too few to tell.
std::optional<double> distance_of_whole_stamps(const std::vector<std::vector<std::string>>& rows,
                                               std::size_t begin, std::size_t column, std::size_t least) {
  double first = 0, last = 0;
  std::size_t count = 0;
  for (std::size_t i = begin; i < rows.size(); ++i) {
    if (column >= rows[i].size() || !whole(rows[i][column])) return std::nullopt;
    last = *parse_double(rows[i][column]);
    if (count++ == 0) first = last;
  }
  if (count < least || !(last > first)) return std::nullopt;
  return (last - first) / static_cast<double>(count - 1);
}

std::int64_t find_unit(const std::filesystem::path& path, const char* what, double distance, double least_s,
                       double most_s, Diagnostics& diagnostics) {
  if (distance <= most_s * 100) return 0;  // seconds, even if slow ones
  const std::int64_t unit = unit_of_stamps(distance, least_s, most_s);
  if (unit == 0)
    throw DataError(fmt::format(
        "{}: {} stamps are whole numbers, {:.3g} apart: no seconds, and their unit cannot be told; "
        "write seconds",
        path.string(), what, distance));
  diagnostics.warn("stamp_unit", fmt::format("{}: {} stamps are whole numbers, {:.3g} apart: taken as {}",
                                             path.string(), what, distance, unit_name(unit)));
  return unit;
}

/// Metavision's order: x, y, polarity and then a stamp.
bool is_metavision_order(const std::vector<std::vector<std::string>>& rows, std::size_t begin) {
  constexpr double kLargestPixel = 8191;
  bool stamp_last = false;
  for (std::size_t i = begin; i < rows.size(); ++i) {
    if (rows[i].size() != 4) return false;
    for (const std::string& token : rows[i])
      if (!parse_integer(token)) return false;
    const double x = *parse_double(rows[i][0]), y = *parse_double(rows[i][1]), p = *parse_double(rows[i][2]);
    if (x < 0 || y < 0 || x > kLargestPixel || y > kLargestPixel || std::abs(p) > 1) return false;
    stamp_last = stamp_last || std::abs(*parse_double(rows[i][3])) > 1;
  }
  return stamp_last;
}

}  // namespace

const char* unit_name(std::int64_t ns) {
  return ns == kUnits[0] ? "ns" : ns == kUnits[1] ? "us" : ns == kUnits[2] ? "ms" : "s";
}

std::int64_t unit_of_stamps(double mean_distance, double least_s, double most_s) {
  std::int64_t found = 0;
  for (const std::int64_t ns : kUnits) {
    const double seconds = mean_distance * 1e-9 * static_cast<double>(ns);
    if (seconds < least_s || seconds > most_s) continue;
    if (found != 0) return 0;
    found = ns;
  }
  return found;
}

EventTextLayout find_event_layout(const std::filesystem::path& path, Diagnostics& diagnostics) {
  EventTextLayout layout;
  const Beginning beginning(path);
  const auto& rows = beginning.rows;
  bool metavision = false;
  for (const std::string& comment : beginning.comments)
    if (std::string_view rest = comment; rest.starts_with("%geometry:")) {
      rest.remove_prefix(std::string_view("%geometry:").size());
      const auto size = columns_of(rest);
      if (size.size() != 2) continue;
      layout.width = static_cast<int>(parse_integer(size[0]).value_or(0));
      layout.height = static_cast<int>(parse_integer(size[1]).value_or(0));
      metavision = true;
    }
  if (rows.empty()) return layout;
  if (std::all_of(rows[0].begin(), rows[0].end(), is_name)) {
    layout.skip = 1;
    std::array<bool, 4> known{};
    for (std::size_t i = 0; i < rows[0].size(); ++i)
      if (const int column = column_named(rows[0][i]); column >= 0) {
        layout.columns[static_cast<std::size_t>(column)] = i;
        known[static_cast<std::size_t>(column)] = true;
        if (column == 0) layout.stamp_ns = unit_in_name(rows[0][i]);
      }
    if (rows[0].size() != 4 || !std::all_of(known.begin(), known.end(), [](bool k) { return k; }))
      throw DataError(
          fmt::format("{}:1: the first line names columns ({}), which must be t, x, y and polarity",
                      path.string(), printable(fmt::format("{}", fmt::join(rows[0], ",")))));
  } else if (rows[0].size() == 2 && rows.size() > 1 && rows[1].size() == 4 &&
             parse_integer(rows[0][0]).value_or(0) > 0 && parse_integer(rows[0][1]).value_or(0) > 0) {
    layout.skip = 1;
    layout.width = static_cast<int>(parse_integer(rows[0][0]).value_or(0));
    layout.height = static_cast<int>(parse_integer(rows[0][1]).value_or(0));
  } else if (metavision || is_metavision_order(rows, 0)) {
    layout.columns = {3, 0, 1, 2};
    layout.stamp_ns = 1000;
  }
  if (layout.stamp_ns > 0) return layout;
  // From 1000 to 20 million events a second: fewer or more are met for moments only.
  constexpr double kLeast = 5e-8, kMost = 1e-3;
  constexpr std::size_t kEnough = 1000;
  if (const auto distance = distance_of_whole_stamps(rows, layout.skip, layout.columns[0], kEnough))
    layout.stamp_ns = find_unit(path, "event", *distance, kLeast, kMost, diagnostics);
  return layout;
}

ImuTextLayout rpg_imu_layout() { return {"t ax ay az gx gy gz"}; }
ImuTextLayout asl_imu_layout() { return {"t[ns] wx wy wz ax ay az", 1, true}; }
ImuTextLayout tum_vie_imu_layout() { return {"t[us] gx gy gz ax ay az temperature", 1000, true}; }

ImuTextLayout find_imu_layout(const std::filesystem::path& path, Diagnostics& diagnostics) {
  const Beginning beginning(path);
  const auto& rows = beginning.rows;
  if (!beginning.comments.empty()) {
    const std::string first = lower(beginning.comments[0]);
    if (first.find("[ns]") != std::string::npos || first.starts_with("#timestamp,")) return asl_imu_layout();
    if (first.find("(us)") != std::string::npos || first.find("[us]") != std::string::npos)
      return tum_vie_imu_layout();
  }
  ImuTextLayout layout = rpg_imu_layout();
  if (rows.empty()) return layout;
  if (std::all_of(rows[0].begin(), rows[0].end(), is_name)) {
    layout.skip = 1;
    const auto first_of = [&](std::string_view letters) {
      return std::find_if(rows[0].begin() + 1, rows[0].end(), [&](const std::string& name) {
        return letters.find(lower(name)[0]) != std::string_view::npos;
      });
    };
    const auto accel = first_of("a"), gyro = first_of("gwo");
    if (rows[0].size() != 7 || accel == rows[0].end() || gyro == rows[0].end())
      throw DataError(
          fmt::format("{}:1: the first line names columns ({}), which must be t, ax, ay, az, gx, gy and gz",
                      path.string(), printable(fmt::format("{}", fmt::join(rows[0], ",")))));
    layout.gyro_first = gyro < accel;
    layout.stamp_ns = unit_in_name(rows[0][0]);
  }
  if (layout.stamp_ns > 0) return layout;
  constexpr double kLeast = 5e-5, kMost = 0.05;  // 20 Hz to 20 kHz
  constexpr std::size_t kEnough = 20;
  if (const auto distance = distance_of_whole_stamps(rows, layout.skip, 0, kEnough))
    layout.stamp_ns = find_unit(path, "IMU", *distance, kLeast, kMost, diagnostics);
  return layout;
}

}  // namespace idol
