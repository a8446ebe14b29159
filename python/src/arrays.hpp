// Between numpy's arrays and the library's structs.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "idol/base/types.hpp"

namespace idol::python {

namespace py = pybind11;

/// The dtypes of Event (t, x, y, p; 16 bytes) and ImuSample (t, accel, gyro): the library's own memory.
py::dtype event_dtype();
py::dtype imu_dtype();

/// An array of `dtype` over the vector's memory, which it keeps: nothing is copied.
template <class T>
py::array adopt(std::vector<T>&& values, const py::dtype& dtype) {
  auto kept = std::make_unique<std::vector<T>>(std::move(values));
  const auto size = static_cast<py::ssize_t>(kept->size());
  const void* data = kept->data();
  const py::capsule owner(kept.release(), [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return {dtype, {size}, {static_cast<py::ssize_t>(sizeof(T))}, data, owner};
}

/// An array with a row of `width` numbers for each item (width 0: one number, no second axis), as `row` writes
/// it.
template <class Value, class Items, class Row>
py::array_t<Value> rows(const Items& items, py::ssize_t width, Row row) {
  std::vector<py::ssize_t> shape{static_cast<py::ssize_t>(items.size())};
  if (width > 0) shape.push_back(width);
  py::array_t<Value> out(shape);
  Value* to = out.mutable_data();
  for (const auto& item : items) {
    row(item, to);
    to += width > 0 ? width : 1;
  }
  return out;
}

inline void write(const Vec3& v, double* to) { Vec3::Map(to) = v; }
inline void write(const Quat& q, double* to) { Eigen::Vector4d::Map(to) = q.coeffs(); }  // x y z w

py::array_t<double> to_array(const Vec3& v);
py::array_t<double> to_array(const Quat& q);

/// (t [ns], position, orientation x y z w).
py::tuple trajectory_arrays(const Trajectory& trajectory);
/// Throws DataError for arrays of unequal length, and for orientations that are none.
Trajectory trajectory_from_arrays(const py::array_t<Time>& t, const py::array_t<double>& position,
                                  const py::array_t<double>& orientation);

/// A stamp: an integer in nanoseconds or a float in seconds. Throws TypeError.
Time time_from_python(const py::handle& t);

/// A one-dimensional array of whole numbers (or of seconds) of any dtype, read where it lies.
class Column {
 public:
  /// Throws TypeError for what is no one-dimensional array of native integers, bool or float64.
  Column(const py::object& values, const char* name);

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] const char* name() const { return name_; }
  [[nodiscard]] bool is_float() const { return kind_ == 'f'; }

  /// Calls store(i, value) for i in [0, to - from), value in the column's own type.
  template <class Store>
  void read(std::size_t from, std::size_t to, Store store) const {
    switch (kind_ == 'f' ? 64 : kind_ == 'i' ? item_size_ : 16 + item_size_) {
      case 64: return each<double>(from, to, store);
      case 1: return each<std::int8_t>(from, to, store);
      case 2: return each<std::int16_t>(from, to, store);
      case 4: return each<std::int32_t>(from, to, store);
      case 8: return each<std::int64_t>(from, to, store);
      case 17: return each<std::uint8_t>(from, to, store);
      case 18: return each<std::uint16_t>(from, to, store);
      case 20: return each<std::uint32_t>(from, to, store);
      default: return each<std::uint64_t>(from, to, store);
    }
  }

 private:
  template <class T, class Store>
  void each(std::size_t from, std::size_t to, Store& store) const {
    for (std::size_t i = from; i < to; ++i) {
      T value;
      std::memcpy(&value, data_ + static_cast<py::ssize_t>(i) * stride_, sizeof(T));
      store(i - from, value);
    }
  }

  py::array array_;  // keeps the memory
  const char* name_;
  const std::byte* data_ = nullptr;
  py::ssize_t stride_ = 0;
  std::size_t size_ = 0;
  char kind_ = 'i';  // i, u (bool as well) or f, as numpy's
  py::ssize_t item_size_ = 0;
};

}  // namespace idol::python
