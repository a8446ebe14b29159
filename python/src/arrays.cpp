#include "arrays.hpp"

#include <fmt/format.h>

#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol::python {
namespace {

struct Field {
  const char* name;
  py::dtype type;
  const void* place;  // in some object of the struct
};

template <class T>
py::dtype dtype_of(const T& object, const std::vector<Field>& fields) {
  py::list names, formats, offsets;
  for (const Field& field : fields) {
    names.append(field.name);
    formats.append(field.type);
    offsets.append(static_cast<const char*>(field.place) - reinterpret_cast<const char*>(&object));
  }
  return {names, formats, offsets, sizeof(T)};
}

}  // namespace

py::dtype event_dtype() {
  const Event e;
  return dtype_of(e, {{"t", py::dtype::of<Time>(), &e.t},
                      {"x", py::dtype::of<std::uint16_t>(), &e.x},
                      {"y", py::dtype::of<std::uint16_t>(), &e.y},
                      {"p", py::dtype::of<bool>(), &e.polarity}});
}

py::dtype imu_dtype() {
  const ImuSample s;
  const py::dtype vector = py::dtype::from_args(py::make_tuple(py::dtype::of<double>(), 3));
  return dtype_of(s, {{"t", py::dtype::of<Time>(), &s.t}, {"accel", vector, &s.accel}, {"gyro", vector, &s.gyro}});
}

py::array_t<double> to_array(const Vec3& v) { return py::array_t<double>(3, v.data()); }
py::array_t<double> to_array(const Quat& q) { return py::array_t<double>(4, q.coeffs().data()); }

py::tuple trajectory_arrays(const Trajectory& trajectory) {
  return py::make_tuple(
      rows<Time>(trajectory, 0, [](const StampedPose& pose, Time* to) { *to = pose.t; }),
      rows<double>(trajectory, 3, [](const StampedPose& pose, double* to) { write(pose.T.p, to); }),
      rows<double>(trajectory, 4, [](const StampedPose& pose, double* to) { write(pose.T.q, to); }));
}

Trajectory trajectory_from_arrays(const py::array_t<Time>& t, const py::array_t<double>& position,
                                  const py::array_t<double>& orientation) {
  const py::ssize_t n = t.size();
  if (t.ndim() != 1 || position.ndim() != 2 || orientation.ndim() != 2 || position.shape(0) != n ||
      orientation.shape(0) != n || position.shape(1) != 3 || orientation.shape(1) != 4)
    throw DataError("a trajectory needs t of shape (n,), position (n, 3) and orientation (n, 4)");
  Trajectory out;
  out.reserve(static_cast<std::size_t>(n));
  const auto stamps = t.unchecked<1>();
  const auto p = position.unchecked<2>(), q = orientation.unchecked<2>();
  for (py::ssize_t i = 0; i < n; ++i) {
    const Quat rotation(q(i, 3), q(i, 0), q(i, 1), q(i, 2));
    const Vec3 place(p(i, 0), p(i, 1), p(i, 2));
    if (!(std::abs(rotation.norm() - 1) < 0.05) || !place.allFinite())
      throw DataError(fmt::format("pose {} of a trajectory: position must be finite, and (qx, qy, qz, qw) of "
                                  "length 1",
                                  i));
    if (!out.empty() && stamps(i) <= out.back().t)
      throw DataError(fmt::format("pose {} of a trajectory: stamps must increase", i));
    out.push_back({stamps(i), {rotation.normalized(), place}});
  }
  return out;
}

Time time_from_python(const py::handle& t) {
  if (PyFloat_Check(t.ptr())) {
    const double seconds = t.cast<double>();
    if (!(std::abs(seconds) < 4.5e9)) throw DataError("a time in seconds must lie within 145 years of zero");
    return from_seconds(seconds);
  }
  if (PyIndex_Check(t.ptr())) return py::int_(py::reinterpret_borrow<py::object>(t)).cast<Time>();
  throw py::type_error("a time is an integer (nanoseconds) or a float (seconds)");
}

Column::Column(const py::object& values, const char* name) : name_(name) {
  array_ = py::array::ensure(values);
  if (!array_) throw py::error_already_set();
  const py::dtype type = array_.dtype();
  const auto refuse = [&](const std::string& what) {
    throw py::type_error(fmt::format("{}: {}, not {} of {} axes", name, what,
                                     py::str(static_cast<py::object>(type)).cast<std::string>(),
                                     array_.ndim()));
  };
  if (array_.ndim() != 1) refuse("one axis is expected");
  kind_ = type.kind();
  item_size_ = type.itemsize();
  if (kind_ == 'b') kind_ = 'u';
  if (kind_ == 'f' ? item_size_ != 8 : kind_ != 'i' && kind_ != 'u')
    refuse("integers, bool or (for t) float64 are expected");
  if (type.byteorder() != '=' && type.byteorder() != '|') refuse("this machine's byte order is expected");
  data_ = static_cast<const std::byte*>(array_.data());
  stride_ = array_.strides(0);
  size_ = static_cast<std::size_t>(array_.size());
}

}  // namespace idol::python
