#include <pybind11/eigen.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <string>

#include "arrays.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/recording.hpp"
#include "module.hpp"

namespace idol::python {
namespace {

using Mat4 = Eigen::Matrix4d;

constexpr std::array<const char*, 3> kDistortions = {"none", "radtan", "equidistant"};

Distortion parse_distortion(const std::string& name) {
  for (std::size_t i = 0; i < kDistortions.size(); ++i)
    if (name == kDistortions[i]) return static_cast<Distortion>(i);
  throw DataError("distortion '" + name + "': none, radtan and equidistant are known");
}

Mat4 to_matrix(const Pose& T) {
  Mat4 out = Mat4::Identity();
  out.topLeftCorner<3, 3>() = T.R();
  out.topRightCorner<3, 1>() = T.p;
  return out;
}

Pose pose_of(const Mat4& T) {
  constexpr double kTolerance = 1e-3;  // as for the matrices of files
  const Mat3 R = T.topLeftCorner<3, 3>();
  if (!T.allFinite() || (R * R.transpose() - Mat3::Identity()).cwiseAbs().maxCoeff() > kTolerance ||
      R.determinant() < 0)
    throw DataError("T_i_c: a 4 x 4 matrix with an orthonormal rotation is expected");
  return {Quat(R).normalized(), T.topRightCorner<3, 1>()};
}

Rig make_rig(int width, int height, const std::array<double, 4>& intrinsics, const Mat4& T_i_c,
             const std::string& distortion, const std::vector<double>& coeffs, double time_offset_s,
             const ImuNoise& imu) {
  Rig rig;
  Camera& camera = rig.camera;
  camera = {
      width, height, intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], parse_distortion(distortion),
      {}};
  if (coeffs.size() > camera.coeffs.size()) throw DataError("coeffs: more than five");
  std::copy(coeffs.begin(), coeffs.end(), camera.coeffs.begin());
  camera.check("Rig");
  rig.T_i_c = pose_of(T_i_c);
  rig.time_offset_s = time_offset_s;
  rig.imu = imu;
  return rig;
}

Rig load(const std::filesystem::path& sequence, const std::filesystem::path& rig,
         const std::filesystem::path& imu_rig) {
  Diagnostics diagnostics;
  const Rig loaded = load_rig(sequence, rig, imu_rig, &diagnostics, {},
                              sequence.empty() ? CameraChoice{} : camera_choice(sequence));
  for (const auto& [kind, entry] : diagnostics.entries())
    if (PyErr_WarnEx(PyExc_UserWarning, entry.first_message.c_str(), 1) != 0) throw py::error_already_set();
  return loaded;
}

void bind_noise(py::module_& module) {
  py::class_<ImuNoise>(module, "ImuNoise",
                       "Noise of the IMU in continuous time, as Kalibr's imu.yaml gives it (SI units).")
      .def(py::init([](double gyro_density, double gyro_walk, double accel_density, double accel_walk,
                       double rate_hz) {
             return ImuNoise{gyro_density, gyro_walk, accel_density, accel_walk, rate_hz};
           }),
           py::kw_only(), py::arg("gyro_density") = ImuNoise().gyro_density,
           py::arg("gyro_walk") = ImuNoise().gyro_walk, py::arg("accel_density") = ImuNoise().accel_density,
           py::arg("accel_walk") = ImuNoise().accel_walk, py::arg("rate_hz") = ImuNoise().rate_hz)
      .def_readonly("gyro_density", &ImuNoise::gyro_density, "[rad/s/sqrt(Hz)]")
      .def_readonly("gyro_walk", &ImuNoise::gyro_walk, "[rad/s^2/sqrt(Hz)]")
      .def_readonly("accel_density", &ImuNoise::accel_density, "[m/s^2/sqrt(Hz)]")
      .def_readonly("accel_walk", &ImuNoise::accel_walk, "[m/s^3/sqrt(Hz)]")
      .def_readonly("rate_hz", &ImuNoise::rate_hz, "Nominal sample rate [Hz].");
}

}  // namespace

void bind_rig(py::module_& module) {
  bind_noise(module);
  py::class_<Rig>(module, "Rig", "Camera, IMU noise, and how the two are mounted and clocked. Immutable.")
      .def(py::init(&make_rig), py::arg("width"), py::arg("height"), py::arg("intrinsics"), py::arg("T_i_c"),
           py::kw_only(), py::arg("distortion") = "none", py::arg("coeffs") = std::vector<double>(),
           py::arg("time_offset_s") = 0.0, py::arg("imu") = ImuNoise())
      .def_property_readonly("width", [](const Rig& rig) { return rig.camera.width; })
      .def_property_readonly("height", [](const Rig& rig) { return rig.camera.height; })
      .def_property_readonly(
          "intrinsics",
          [](const Rig& rig) {
            const Camera& c = rig.camera;
            return py::make_tuple(c.fx, c.fy, c.cx, c.cy);
          },
          "(fx, fy, cx, cy) [px]; whole numbers are centres of pixels.")
      .def_property_readonly(
          "distortion",
          [](const Rig& rig) { return kDistortions.at(static_cast<std::size_t>(rig.camera.distortion)); })
      .def_property_readonly(
          "coeffs", [](const Rig& rig) { return py::tuple(py::cast(rig.camera.coeffs)); },
          "radtan: k1 k2 p1 p2 k3; equidistant: k1 k2 k3 k4 0.")
      .def_property_readonly(
          "T_i_c", [](const Rig& rig) { return to_matrix(rig.T_i_c); },
          "Pose of the camera in the frame of the IMU, 4 x 4.")
      .def_readonly("time_offset_s", &Rig::time_offset_s, "t_imu = t_camera + time_offset_s.")
      .def_readonly("imu", &Rig::imu)
      .def("to_yaml", &rig_to_yaml, "The rig as a file that load_rig reads.")
      .def("__repr__", [](const Rig& rig) {
        return "<idol.Rig: " + std::to_string(rig.camera.width) + " x " + std::to_string(rig.camera.height) +
               " px, " + kDistortions.at(static_cast<std::size_t>(rig.camera.distortion)) + ">";
      });
  module.def("load_rig", &load, py::arg("sequence"), py::arg("rig"), py::arg("imu_rig"));
}

}  // namespace idol::python
