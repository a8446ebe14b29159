#include <pybind11/eigen.h>
#include <pybind11/stl.h>

#include <map>
#include <string>

#include "idol/odometry/presets.hpp"
#include "module.hpp"
#include "options.hpp"
#include "session.hpp"

namespace idol::python {
namespace {

using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Readings as rows of three; one sample may be given without the first axis.
Doubles rows_of_three(const Doubles& values, std::size_t count, const char* name) {
  const bool one = values.ndim() == 1 && values.shape(0) == 3 && count == 1;
  const bool many = values.ndim() == 2 && values.shape(1) == 3 && values.shape(0) == static_cast<py::ssize_t>(count);
  if (!one && !many)
    throw DataError(std::string(name) + ": three numbers for each of the " + std::to_string(count) +
                    " stamps are expected");
  return values;
}

std::vector<ImuSample> imu_samples(const py::object& t, const Doubles& accel, const Doubles& gyro) {
  std::vector<ImuSample> samples;
  if (py::isinstance<py::array>(t) && t.attr("ndim").cast<int>() > 0) {
    const Column stamps(t, "t");
    samples.resize(stamps.size());
    stamps.read(0, stamps.size(), [&](std::size_t i, auto value) {
      if constexpr (std::is_floating_point_v<decltype(value)>)
        samples[i].t = time_from_python(py::float_(value));
      else
        samples[i].t = static_cast<Time>(value);
    });
  } else {
    samples.push_back({time_from_python(t)});
  }
  const double* a = rows_of_three(accel, samples.size(), "accel").data();
  const double* g = rows_of_three(gyro, samples.size(), "gyro").data();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].accel = Vec3::Map(a + 3 * i);
    samples[i].gyro = Vec3::Map(g + 3 * i);
  }
  return samples;
}

void bind_state(py::module_& module) {
  py::class_<NavState>(module, "State", "Motion of the IMU in the world at one time.")
      .def_readonly("t", &NavState::t, "[ns], clock of the IMU")
      .def_property_readonly("position", [](const NavState& s) { return to_array(s.T_w_i.p); }, "[m]")
      .def_property_readonly(
          "orientation", [](const NavState& s) { return to_array(s.T_w_i.q); }, "qx qy qz qw")
      .def_property_readonly("velocity", [](const NavState& s) { return to_array(s.v_w); }, "[m/s]")
      .def_property_readonly("gyro_bias", [](const NavState& s) { return to_array(s.bias.gyro); }, "[rad/s]")
      .def_property_readonly("accel_bias", [](const NavState& s) { return to_array(s.bias.accel); }, "[m/s^2]")
      .def_readonly("time_shift_s", &NavState::time_shift, "of the camera's clock, beyond the rig's [s]")
      .def_readonly("event_lag_px", &NavState::event_lag_px, "how far events trail their edges [px]");
}

py::dict figures_of(const SolveStats& stats) {
  py::dict out;
  out["lines"] = stats.lines;
  out["residuals"] = stats.residuals;
  out["iterations"] = stats.iterations;
  out["restarts"] = stats.restarts;
  out["cost"] = stats.cost;
  out["rms_px"] = stats.rms_px;
  out["mean_track_s"] = stats.mean_track_s;
  return out;
}

void bind_estimate(py::module_& module) {
  py::class_<PyEstimate, std::shared_ptr<PyEstimate>>(module, "Estimate", "What is known after a window of events.")
      .def_readonly("state", &PyEstimate::state, "At the window's end.")
      .def_property_readonly("t", [](const PyEstimate& e) { return e.state.t; }, "[ns], clock of the IMU")
      .def_property_readonly(
          "position", [](const PyEstimate& e) { return to_array(e.T_w_c.p); }, "of the camera [m]")
      .def_property_readonly(
          "orientation", [](const PyEstimate& e) { return to_array(e.T_w_c.q); }, "of the camera, qx qy qz qw")
      .def_property_readonly(
          "settled", [](const PyEstimate& e) { return e.stats.settled; },
          "False after a start in motion, until the velocity is known.")
      .def_readonly("events", &PyEstimate::events, "Number of events in the window.")
      .def_property_readonly(
          "stats", [](const PyEstimate& e) { return figures_of(e.stats); }, "Figures of the solver.")
      .def_property_readonly(
          "seconds",
          [](const PyEstimate& e) {
            py::dict out;
            out["segment"] = e.segment_s;
            out["integrate"] = e.integrate_s;
            out["solve"] = e.solve_s;
            return out;
          },
          "Time spent in each stage [s].")
      .def("_lines", [](const PyEstimate& e) { return to_dict(e.backend().lines()); })
      .def("covariance", [](const PyEstimate& e) { return e.backend().covariance(); },
           "17 x 17, in the order position, rotation, velocity, gyro bias, accelerometer bias, time shift, event "
           "lag; None if the estimator has none. While on_estimate's function runs only.");
}

}  // namespace

void bind_odometry(py::module_& module) {
  bind_state(module);
  bind_estimate(module);
  py::class_<Session>(module, "Session")
      .def(py::init([](const Rig& rig, const std::string& preset, const Settings& settings) {
             return std::make_unique<Session>(rig, make_options(preset, settings));
           }),
           py::arg("rig"), py::arg("preset"), py::arg("options"))
      .def("on_estimate", &Session::on_estimate, py::arg("function"))
      .def("push_events",
           [](Session& session, const py::object& t, const py::object& x, const py::object& y,
              const py::object& p) { session.push_events({t, x, y, p}); })
      .def("push_events",
           [](Session& session, const py::object& events) { session.push_events(EventColumns(events)); })
      .def("push_imu", [](Session& session, const py::object& t, const Doubles& accel,
                          const Doubles& gyro) { session.push_imu(imu_samples(t, accel, gyro)); })
      .def("end_imu", &Session::end_imu)
      .def("wait", &Session::wait)
      .def("finish", &Session::finish)
      .def("predict", [](Session& session, const py::object& t) { return session.predict(time_from_python(t)); })
      .def("states", [](Session& session) { return to_dict(session.states()); })
      .def("lines", [](Session& session) { return to_dict(session.lines()); })
      .def("trajectory", [](Session& session) { return trajectory_arrays(session.camera()); })
      .def("warnings", [](Session& session) { return to_dict(session.diagnostics()); })
      .def("close", &Session::close);
  module.def("config", [](const std::string& preset, const Settings& settings) {
    Options options = make_options(preset, settings);
    std::vector<OptionField> fields;
    list_fields(options, fields);
    return dump_options(fields);
  });
}

}  // namespace idol::python
