// idol._core: what Python sees of the library. The package around it is python/idol.
#include "module.hpp"

#include "arrays.hpp"
#include "idol/base/ready_rigs.hpp"
#include "idol/version.hpp"

#include <pybind11/stl.h>

namespace idol::python {

py::dict to_dict(const Diagnostics& diagnostics) {
  py::dict out;
  for (const auto& [kind, entry] : diagnostics.entries())
    out[py::str(kind)] = py::make_tuple(entry.first_message, entry.count);
  return out;
}

py::dict to_dict(const std::vector<NavState>& states) {
  using State = const NavState&;
  py::dict out;
  out["t"] = rows<Time>(states, 0, [](State s, Time* to) { *to = s.t; });
  out["position"] = rows<double>(states, 3, [](State s, double* to) { write(s.T_w_i.p, to); });
  out["orientation"] = rows<double>(states, 4, [](State s, double* to) { write(s.T_w_i.q, to); });
  out["velocity"] = rows<double>(states, 3, [](State s, double* to) { write(s.v_w, to); });
  out["gyro_bias"] = rows<double>(states, 3, [](State s, double* to) { write(s.bias.gyro, to); });
  out["accel_bias"] = rows<double>(states, 3, [](State s, double* to) { write(s.bias.accel, to); });
  out["time_shift_s"] = rows<double>(states, 0, [](State s, double* to) { *to = s.time_shift; });
  out["event_lag_px"] = rows<double>(states, 0, [](State s, double* to) { *to = s.event_lag_px; });
  return out;
}

py::dict to_dict(const std::vector<Line>& lines) {
  using L = const Line&;
  py::dict out;
  out["id"] = rows<LineId>(lines, 0, [](L l, LineId* to) { *to = l.id; });
  out["a"] = rows<double>(lines, 3, [](L l, double* to) { write(l.a, to); });
  out["b"] = rows<double>(lines, 3, [](L l, double* to) { write(l.b, to); });
  out["first"] = rows<Time>(lines, 0, [](L l, Time* to) { *to = l.first; });
  out["last"] = rows<Time>(lines, 0, [](L l, Time* to) { *to = l.last; });
  out["windows"] = rows<std::int64_t>(lines, 0, [](L l, std::int64_t* to) { *to = l.windows; });
  out["events"] = rows<std::int64_t>(lines, 0, [](L l, std::int64_t* to) { *to = l.events; });
  return out;
}

}  // namespace idol::python

PYBIND11_MODULE(_core, module) {
  namespace py = pybind11;
  module.doc() = "The compiled part of idol.";
  module.attr("__version__") = idol::kVersion;
  py::register_exception<idol::DataError>(module, "DataError", PyExc_ValueError).doc() =
      "Bad data: a file, rig, recording or array. The message says what, where and what to do.";
  py::register_exception<idol::UsageError>(module, "UsageError", PyExc_ValueError).doc() =
      "An option or name that does not exist, or a value out of range.";
  module.attr("event_dtype") = idol::python::event_dtype();
  module.attr("imu_dtype") = idol::python::imu_dtype();
  module.def(
      "ready_rigs",
      [] {
        std::vector<std::string> names;
        for (const idol::ReadyRig& rig : idol::ready_rigs()) names.emplace_back(rig.name);
        return names;
      },
      "Names of the rigs that come with idol.");
  idol::python::bind_rig(module);
  idol::python::bind_odometry(module);
  idol::python::bind_recordings(module);
  idol::python::bind_jobs(module);
}
