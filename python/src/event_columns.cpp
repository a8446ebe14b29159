#include "event_columns.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol::python {
namespace {

py::object field(const py::object& events, const char* name) {
  if (!py::isinstance<py::array>(events) || events.attr("dtype").attr("names").is_none() ||
      !events.attr("dtype").attr("names").contains(name))
    throw py::type_error("events: four arrays t, x, y, p are expected, or one with these fields");
  return events[py::str(name)];
}

template <class T>
Time stamp(T value) {
  if constexpr (std::is_floating_point_v<T>) {
    constexpr double kFarthest = 4.5e9;  // [s]: 145 years
    if (!(std::abs(value) < kFarthest))
      throw DataError(fmt::format("t: {} is no stamp in seconds (integers are nanoseconds)", value));
    return from_seconds(value);
  } else {
    return static_cast<Time>(value);
  }
}

template <class T>
std::uint16_t pixel(T value, int size, const char* name) {
  if (!(value >= T{0} && static_cast<double>(value) < size))
    throw DataError(fmt::format("{}: {} is outside the sensor, which has {} pixels there", name, value, size));
  return static_cast<std::uint16_t>(value);
}

}  // namespace

EventColumns::EventColumns(const py::object& t, const py::object& x, const py::object& y, const py::object& p)
    : t_(t, "t"), x_(x, "x"), y_(y, "y"), p_(p, "p") {
  check_types();
}

EventColumns::EventColumns(const py::object& events)
    : EventColumns(field(events, "t"), field(events, "x"), field(events, "y"), field(events, "p")) {}

void EventColumns::check_types() const {
  for (const Column* column : {&x_, &y_, &p_}) {
    if (column->is_float()) throw py::type_error(fmt::format("{}: whole numbers are expected", column->name()));
    if (column->size() != t_.size())
      throw DataError(fmt::format("t has {} values, {} has {}", t_.size(), column->name(), column->size()));
  }
}

void EventColumns::fill(std::size_t from, std::size_t to, const Camera& camera, Event* out) const {
  t_.read(from, to, [&](std::size_t i, auto value) { out[i].t = stamp(value); });
  x_.read(from, to, [&](std::size_t i, auto value) { out[i].x = pixel(value, camera.width, "x"); });
  y_.read(from, to, [&](std::size_t i, auto value) { out[i].y = pixel(value, camera.height, "y"); });
  p_.read(from, to, [&](std::size_t i, auto value) { out[i].polarity = value > 0; });
}

std::span<const Event> EventColumns::piece(std::size_t from, const Camera& camera, std::optional<Time>& last,
                                           Piece& buffer) const {
  constexpr Time kLongestLeap = 600'000'000'000;  // [ns]
  const std::size_t to = std::min(size(), from + kPiece);
  fill(from, to, camera, buffer.data());
  const std::span<const Event> events(buffer.data(), to - from);
  for (const Event& event : events) {
    if (last && event.t < *last)
      throw DataError(fmt::format("t: {} ns comes after {} ns; events must be in order of time", event.t, *last));
    if (last && event.t - *last > kLongestLeap)
      throw DataError(fmt::format("t: {} ns comes after {} ns, more than 10 minutes before", event.t, *last));
    last = event.t;
  }
  return events;
}

}  // namespace idol::python
