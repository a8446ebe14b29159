// Events in numpy arrays, made into the library's piece by piece: no array is converted as a whole.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "arrays.hpp"
#include "idol/base/camera.hpp"

namespace idol::python {

class EventColumns {
 public:
  /// Four arrays of one length. Throws TypeError or DataError.
  EventColumns(const py::object& t, const py::object& x, const py::object& y, const py::object& p);
  /// One structured array with the fields t, x, y and p.
  explicit EventColumns(const py::object& events);

  static constexpr std::size_t kPiece = 4096;
  using Piece = std::array<Event, kPiece>;

  [[nodiscard]] std::size_t size() const { return t_.size(); }
  /// The events from `from` on, as many as fit into `buffer`, checked: pixels on the sensor, stamps that do not
  /// fall (from `last` on) nor leap ahead by more than 10 minutes. Needs no GIL. Throws DataError.
  std::span<const Event> piece(std::size_t from, const Camera& camera, std::optional<Time>& last,
                               Piece& buffer) const;

 private:
  void check_types() const;
  void fill(std::size_t from, std::size_t to, const Camera& camera, Event* out) const;

  Column t_, x_, y_, p_;
};

}  // namespace idol::python
