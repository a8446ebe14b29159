#include "idol/base/calibration_files.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <set>
#include <string>
#include <tuple>

#include "idol/base/calibration_checks.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/foreign_calibrations.hpp"
#include "idol/base/yaml_file.hpp"

namespace idol {
namespace {

Distortion distortion_of(const YamlNode& node) {
  const std::string name = node.text();
  if (name == "radtan" || name == "plumb_bob") return Distortion::kRadTan;
  if (name == "equidistant") return Distortion::kEquidistant;
  if (name == "none") return Distortion::kNone;
  node.refuse(
      fmt::format("'{}' is not supported; calibrate with radtan, equidistant or none", printable(name)));
}

Camera lens_of(const YamlNode& cam) {
  Camera camera;
  if (cam.has("camera_model")) {
    const YamlNode model = cam.at("camera_model");
    if (model.text() != "pinhole")
      model.refuse(
          fmt::format("'{}' is not supported; calibrate with the pinhole model", printable(model.text())));
  }
  const YamlNode intrinsics = cam.at("intrinsics");
  const std::vector<double> f = intrinsics.numbers();
  if (f.size() != 4)
    intrinsics.refuse(fmt::format("{} numbers where 4 are expected (fx fy cx cy)", f.size()));
  camera.fx = f[0], camera.fy = f[1], camera.cx = f[2], camera.cy = f[3];
  if (!(camera.fx > 0 && camera.fy > 0)) intrinsics.refuse("focal lengths must be positive");

  camera.distortion = distortion_of(cam.at("distortion_model"));
  if (camera.distortion == Distortion::kNone) return camera;
  const YamlNode coeffs = cam.at("distortion_coeffs");
  const std::vector<double> k = coeffs.numbers();
  const std::size_t most = camera.distortion == Distortion::kRadTan ? 5 : 4;
  if (k.size() < 4 || k.size() > most) {
    coeffs.refuse(fmt::format("{} numbers where {} are expected", k.size(),
                              most == 5 ? "4 (k1 k2 p1 p2) or 5 (and k3)" : "4 (k1 k2 k3 k4)"));
  }
  std::copy(k.begin(), k.end(), camera.coeffs.begin());
  return camera;
}

/// A 4 x 4 rigid transformation; its rotation is made exactly orthonormal.
Pose pose_of(const YamlNode& node) {
  const std::vector<YamlNode> rows = node.items();
  if (rows.size() != 4) node.refuse(fmt::format("{} rows where a 4 x 4 matrix is expected", rows.size()));
  Eigen::Matrix4d T;
  for (std::size_t r = 0; r < 4; ++r) {
    const std::vector<double> row = rows[r].numbers();
    if (row.size() != 4)
      rows[r].refuse(fmt::format("{} columns where a 4 x 4 matrix is expected", row.size()));
    T.row(static_cast<Eigen::Index>(r)) = Eigen::Map<const Eigen::RowVector4d>(row.data());
  }
  constexpr double kTolerance = 1e-3;  // more than rounding explains
  const Mat3 R = T.topLeftCorner<3, 3>();
  if ((R.transpose() * R - Mat3::Identity()).cwiseAbs().maxCoeff() > kTolerance || R.determinant() < 0)
    node.refuse("the upper left 3 x 3 block is not a rotation (not orthonormal, or mirrored)");
  if ((T.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > kTolerance)
    node.refuse("the last row must be 0 0 0 1");
  const Eigen::JacobiSVD<Mat3> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Mat3 nearest = svd.matrixU() * svd.matrixV().transpose();
  return {Quat(nearest).normalized(), T.topRightCorner<3, 1>()};
}

ImuNoise noise_of(const YamlNode& imu, Diagnostics& remarks) {
  const auto at_least = [&](const char* key, bool zero_allowed) {
    const YamlNode node = imu.at(key);
    const double value = node.number();
    if (value < 0 || (value == 0 && !zero_allowed)) node.refuse("must be positive");
    return value;
  };
  const auto noise_at = [&](const char* key, const NoiseRange& range, bool zero_allowed) {
    return checked_noise(imu.at(key), at_least(key, zero_allowed), range, remarks);
  };
  ImuNoise noise;
  noise.gyro_density = noise_at("gyroscope_noise_density", kGyroDensity, false);
  noise.gyro_walk = noise_at("gyroscope_random_walk", kGyroWalk, true);
  noise.accel_density = noise_at("accelerometer_noise_density", kAccelDensity, false);
  noise.accel_walk = noise_at("accelerometer_random_walk", kAccelWalk, true);
  noise.rate_hz = at_least("update_rate", false);
  return noise;
}

std::pair<int, int> size_of(const YamlNode& cam) {
  if (!cam.has("resolution")) return {0, 0};
  const YamlNode resolution = cam.at("resolution");
  const std::vector<YamlNode> size = resolution.items();
  if (size.size() != 2) resolution.refuse("the resolution is two whole numbers, [width, height]");
  return {pixels_of(size[0]), pixels_of(size[1])};
}

/// The keys cam0, cam1, ... of a camchain.
std::vector<ListedCamera> cameras_of(const YamlNode& root) {
  std::vector<ListedCamera> cameras;
  for (const std::string& key : root.keys()) {
    if (!key.starts_with("cam") || key.find_first_not_of("0123456789", 3) != std::string::npos ||
        key.size() == 3)
      continue;
    const auto [width, height] = size_of(root.at(key));
    cameras.push_back({key, width, height});
  }
  return cameras;
}

/// How the camera is mounted on the IMU. Kalibr gives the IMU in the camera's frame, OpenVINS the camera in
/// the IMU's; Kalibr's camera chains give each camera but the first in the frame of the one before.
std::optional<Pose> mounting_of(const YamlNode& root, const std::string& name, Diagnostics& remarks) {
  const YamlNode cam = root.at(name);
  std::optional<Pose> T_i_c;
  if (cam.has("T_imu_cam")) T_i_c = pose_of(cam.at("T_imu_cam"));
  if (cam.has("T_cam_imu")) {
    const YamlNode node = cam.at("T_cam_imu");
    const Pose inverse = pose_of(node).inverse();
    constexpr double kSameAngle = 0.01, kSamePlace = 0.01;  // [rad], [m]
    if (T_i_c && ((T_i_c->p - inverse.p).norm() > kSamePlace ||
                  quat_log(T_i_c->q.conjugate() * inverse.q).norm() > kSameAngle))
      node.refuse("contradicts T_imu_cam, of which it must be the inverse; take the wrong one out");
    T_i_c = inverse;
  }
  if (T_i_c) {
    check_lever_arm(cam.at(cam.has("T_cam_imu") ? "T_cam_imu" : "T_imu_cam"), *T_i_c, remarks);
    return T_i_c;
  }
  if (!cam.has("T_cn_cnm1")) return std::nullopt;
  const std::string before = fmt::format("cam{}", std::stoi(name.substr(3)) - 1);
  if (!root.has(before)) return std::nullopt;
  const auto T_i_before = mounting_of(root, before, remarks);
  if (!T_i_before) return std::nullopt;
  return *T_i_before * pose_of(cam.at("T_cn_cnm1")).inverse();
}

void read_camera(const YamlNode& root, const std::string& name, CalibrationFile& file) {
  const YamlNode cam = root.at(name);
  std::tie(file.width, file.height) = size_of(cam);
  if (cam.has("intrinsics")) {
    file.camera = lens_of(cam);
    file.camera->width = file.width;
    file.camera->height = file.height;
    check_centre(cam.at("intrinsics"), *file.camera, file.remarks);
  }
  file.T_i_c = mounting_of(root, name, file.remarks);
  if (cam.has("timeshift_cam_imu")) {
    const YamlNode shift = cam.at("timeshift_cam_imu");
    file.time_offset_s = shift.number();
    check_time_shift(shift, *file.time_offset_s, file.remarks);
  }
  warn_of_unused(cam,
                 {"T_cam_imu", "T_imu_cam", "T_cn_cnm1", "camera_model", "intrinsics", "distortion_model",
                  "distortion_coeffs", "resolution", "timeshift_cam_imu", "cam_overlaps", "rostopic"},
                 file.remarks);
}

}  // namespace

int pixels_of(const YamlNode& node) {
  const double value = node.number();
  constexpr double kLargest = 8192;
  if (value < 1 || value > kLargest || value != std::floor(value))
    node.refuse("the resolution is two whole numbers, [width, height]");
  return static_cast<int>(value);
}

CalibrationFile read_calibration(const YamlNode& root, const CameraChoice& choice) {
  if (root.has("value0")) return read_basalt_file(root, choice);
  CalibrationFile file;
  const std::vector<ListedCamera> cameras = cameras_of(root);
  if (!cameras.empty())
    read_camera(root, cameras[choose_camera(root.file(), cameras, choice, file.remarks)].name, file);
  const YamlNode imu = root.has("imu0") ? root.at("imu0") : root;
  for (const char* key : {"accelerometer_noise_density", "gyroscope_noise_density"})
    if (imu.has(key) && !file.imu) file.imu = noise_of(imu, file.remarks);
  std::set<std::string> used{"accelerometer_noise_density",
                             "accelerometer_random_walk",
                             "gyroscope_noise_density",
                             "gyroscope_random_walk",
                             "update_rate",
                             "rostopic",
                             "imu0",
                             "approximate"};
  for (const ListedCamera& camera : cameras) used.insert(camera.name);
  warn_of_unused(imu, used, file.remarks);
  if (root.has("approximate")) file.approximate = root.at("approximate").text() == "true";
  if (cameras.empty() && !file.imu) {
    throw DataError(
        fmt::format("{}: neither 'cam0' nor IMU noise in this file; Kalibr's camchain-imucam.yaml or "
                    "imu.yaml, or Basalt's calibration.json, is expected",
                    root.where()));
  }
  return file;
}

CalibrationFile read_calibration_file(const std::filesystem::path& path, const CameraChoice& choice) {
  return read_calibration(YamlNode::load(path), choice);
}

Camera read_rpg_calibration(const std::filesystem::path& path) {
  const std::string name = path.string();
  std::ifstream in(path, std::ios::binary);
  if (!in) throw DataError(fmt::format("{}: cannot be read", name));
  std::vector<double> v;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (const auto comment = line.find('#'); comment != std::string::npos) line.resize(comment);
    const char* p = line.data();
    const char* end = p + line.size();
    const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == ',' || c == '\r'; };
    while (true) {
      while (p != end && is_blank(*p)) ++p;
      if (p == end) break;
      double value = 0;
      const auto [stop, error] = std::from_chars(p, end, value);
      if (error != std::errc() || !std::isfinite(value) || (stop != end && !is_blank(*stop)))
        throw DataError(fmt::format("{}:{}: column {} is not a finite number", name, number, v.size() + 1));
      v.push_back(value);
      p = stop;
    }
  }
  if (v.size() != 9) {
    throw DataError(
        fmt::format("{}:1: {} numbers where 9 are expected (fx fy cx cy k1 k2 p1 p2 k3)", name, v.size()));
  }
  if (!(v[0] > 0 && v[1] > 0)) throw DataError(fmt::format("{}:1: focal lengths must be positive", name));
  Camera camera{0, 0, v[0], v[1], v[2], v[3], Distortion::kRadTan, {}};
  std::copy(v.begin() + 4, v.end(), camera.coeffs.begin());
  return camera;
}

std::pair<int, int> png_size(const std::filesystem::path& path) {
  std::array<unsigned char, 24> head{};
  std::ifstream in(path, std::ios::binary);
  if (!in.read(reinterpret_cast<char*>(head.data()), head.size())) return {0, 0};
  constexpr std::array<unsigned char, 8> kMagic = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (!std::equal(kMagic.begin(), kMagic.end(), head.begin())) return {0, 0};
  const auto big_endian = [&](std::size_t i) {
    return (head[i] << 24) | (head[i + 1] << 16) | (head[i + 2] << 8) | head[i + 3];
  };
  return {big_endian(16), big_endian(20)};
}

}  // namespace idol
