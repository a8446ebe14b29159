// One line of text as one event or one IMU sample.
#pragma once

#include <cstdint>
#include <string_view>
#include <utility>

#include "idol/base/types.hpp"
#include "idol/io/number.hpp"
#include "idol/io/row_source.hpp"
#include "idol/io/text_layout.hpp"

namespace idol {

/// "t x y polarity" unless the file's layout says otherwise; polarity 0, -1 or False for darker, 1 or True
/// for brighter.
class EventParser {
 public:
  using Row = Event;

  explicit EventParser(const EventTextLayout& layout = {}) : layout_(layout), usual_(layout.usual()) {}
  /// The row in its usual form; false if it must be looked at with explain().
  bool parse(std::string_view line, Event& event) const {
    if (!usual_) return false;
    const char* p = line.data();
    const char* end = p + line.size();
    std::uint32_t x = 0;
    std::uint32_t y = 0;
    p = parse_plain_stamp(p, end, event.t);
    if (p == nullptr || !next_pixel(p, end, x) || !next_pixel(p, end, y) || x > kLargestPixel ||
        y > kLargestPixel)
      return false;
    if (!skip_separators(p, end)) return false;
    if (*p == '-' && p + 1 != end && p[1] == '1') {
      event.polarity = false;
      p += 2;
    } else if (*p == '0' || *p == '1') {
      event.polarity = *p == '1';
      ++p;
    } else {
      return false;
    }
    event.x = static_cast<std::uint16_t>(x);
    event.y = static_cast<std::uint16_t>(y);
    return p == end;
  }
  /// The same for any row, slowly: also scientific notation, comments and every kind of damage.
  RowResult explain(std::string_view line, Event& event) const;

 private:
  /// At least one separator, and something behind it.
  static bool skip_separators(const char*& p, const char* end) {
    const char* start = p;
    while (p != end && is_separator(*p)) ++p;
    return p != start && p != end;
  }
  static bool next_pixel(const char*& p, const char* end, std::uint32_t& value) {
    if (!skip_separators(p, end)) return false;
    const char* start = p;
    for (value = 0; p != end && is_digit(*p) && p - start < 6; ++p)
      value = value * 10 + static_cast<std::uint32_t>(*p - '0');
    return p != start;
  }

  static constexpr std::uint32_t kLargestPixel = 0xffff;
  EventTextLayout layout_;
  bool usual_;
};

class ImuParser {
 public:
  using Row = ImuSample;

  explicit ImuParser(ImuTextLayout layout) : layout_(std::move(layout)) {}
  bool parse(std::string_view, ImuSample&) const { return false; }
  RowResult explain(std::string_view line, ImuSample& sample) const;

 private:
  ImuTextLayout layout_;
};

}  // namespace idol
