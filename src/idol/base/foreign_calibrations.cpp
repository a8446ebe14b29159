#include "idol/base/foreign_calibrations.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "idol/base/calibration_checks.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/yaml_file.hpp"

namespace idol {
namespace {

Camera basalt_camera(const YamlNode& camera, const std::vector<YamlNode>& size) {
  const YamlNode type = camera.at("camera_type"), values = camera.at("intrinsics");
  const auto value = [&](const char* key) { return values.at(key).number(); };
  Camera lens;
  lens.fx = value("fx"), lens.fy = value("fy"), lens.cx = value("cx"), lens.cy = value("cy");
  if (!(lens.fx > 0 && lens.fy > 0)) values.refuse("focal lengths must be positive");
  if (size.size() != 2) camera.refuse("the resolution is two whole numbers");
  lens.width = pixels_of(size[0]), lens.height = pixels_of(size[1]);
  if (type.text() == "pinhole") {
    lens.distortion = Distortion::kNone;
  } else if (type.text() == "kb4") {
    lens.distortion = Distortion::kEquidistant;
    lens.coeffs = {value("k1"), value("k2"), value("k3"), value("k4")};
  } else if (type.text() == "pinhole-radtan8") {
    if (value("k4") != 0 || value("k5") != 0 || value("k6") != 0)
      values.refuse("k4, k5 and k6 must be 0: the rational model is not supported");
    lens.distortion = Distortion::kRadTan;
    lens.coeffs = {value("k1"), value("k2"), value("p1"), value("p2"), value("k3")};
  } else {
    type.refuse(fmt::format("'{}' is not supported; calibrate with pinhole, kb4 or pinhole-radtan8",
                            printable(type.text())));
  }
  return lens;
}

/// Basalt writes one number or one an axis; the largest counts.
double largest(const YamlNode& node) {
  double most = 0;
  for (const double v : node.is_list() ? node.numbers() : std::vector<double>{node.number()})
    most = std::max(most, v);
  if (!(most >= 0)) node.refuse("must be positive");
  return most;
}

/// An XML file, of which only what stands between a tag and its end is looked at.
class Xml {
 public:
  explicit Xml(const std::filesystem::path& path) : name_(path.string()) {
    std::ifstream in(path, std::ios::binary);
    std::stringstream content;
    if (!in || !(content << in.rdbuf())) throw DataError(fmt::format("{}: cannot be read", name_));
    text_ = content.str();
  }
  /// What the first element of this name holds, within `part`.
  [[nodiscard]] std::string_view element(std::string_view part, const std::string& tag) const {
    const auto found = find(part, tag);
    if (!found) refuse(part, fmt::format("<{}> is missing", tag));
    return *found;
  }
  [[nodiscard]] std::optional<std::string_view> find(std::string_view part, const std::string& tag) const {
    for (auto at = part.find("<" + tag); at != std::string_view::npos; at = part.find("<" + tag, at + 1)) {
      const char next = at + 1 + tag.size() < part.size() ? part[at + 1 + tag.size()] : '\0';
      if (next != '>' && next != ' ') continue;  // a longer name
      const auto begin = part.find('>', at), end = part.find("</" + tag + ">", at);
      if (begin < end && end != std::string_view::npos) return part.substr(begin + 1, end - begin - 1);
    }
    return std::nullopt;
  }
  [[nodiscard]] std::vector<double> numbers(std::string_view part) const {
    std::vector<double> values;
    const char* p = part.data();
    const char* end = p + part.size();
    while (true) {
      while (p != end && (*p == ' ' || *p == '\n' || *p == '\r' || *p == '\t')) ++p;
      if (p == end) return values;
      double value = 0;
      const auto [stop, error] = std::from_chars(p, end, value);
      if (error != std::errc() || !std::isfinite(value)) refuse(part, "not a finite number");
      values.push_back(value);
      p = stop;
    }
  }
  [[nodiscard]] std::string_view text() const { return text_; }
  [[noreturn]] void refuse(std::string_view part, const std::string& why) const {
    const auto lines = std::count(text_.data(), part.data(), '\n');
    throw DataError(fmt::format("{}:{}: {}", name_, lines + 1, why));
  }

 private:
  std::string name_, text_;
};

}  // namespace

bool is_opencv_xml(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string start(512, '\0');
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  return start.find("<opencv_storage>") != std::string::npos;
}

CalibrationFile read_basalt_file(const YamlNode& root, const CameraChoice& choice) {
  const YamlNode calibration = root.at("value0");
  CalibrationFile file;
  std::vector<ListedCamera> cameras;
  for (const YamlNode& size : calibration.at("resolution").items()) {
    const auto sides = size.items();
    if (sides.size() != 2) size.refuse("the resolution is two whole numbers");
    cameras.push_back({fmt::format("cam{}", cameras.size()), pixels_of(sides[0]), pixels_of(sides[1])});
  }
  if (cameras.empty()) calibration.at("resolution").refuse("the list is empty");
  const std::size_t chosen = choose_camera(root.file(), cameras, choice, file.remarks);
  const auto of_chosen = [&](const char* key) {
    const YamlNode list = calibration.at(key);
    const auto items = list.items();
    if (items.size() <= chosen) list.refuse(fmt::format("has no entry for {}", cameras[chosen].name));
    return items[chosen];
  };
  file.camera = basalt_camera(of_chosen("intrinsics"), of_chosen("resolution").items());
  file.width = file.camera->width;
  file.height = file.camera->height;
  check_centre(of_chosen("intrinsics"), *file.camera, file.remarks);
  const YamlNode T = of_chosen("T_imu_cam");
  const auto value = [&](const char* key) { return T.at(key).number(); };
  const Quat q(value("qw"), value("qx"), value("qy"), value("qz"));
  constexpr double kTolerance = 1e-3;
  if (std::abs(q.norm() - 1) > kTolerance) T.refuse("the quaternion must have length 1");
  file.T_i_c = Pose{q.normalized(), Vec3(value("px"), value("py"), value("pz"))};
  check_lever_arm(T, *file.T_i_c, file.remarks);
  if (calibration.has("cam_time_offset_ns")) {
    const YamlNode shift = calibration.at("cam_time_offset_ns");
    file.time_offset_s = shift.number() * 1e-9;
    check_time_shift(shift, *file.time_offset_s, file.remarks);
  }
  const auto noise_at = [&](const char* key, const NoiseRange& range) {
    const YamlNode node = calibration.at(key);
    return checked_noise(node, largest(node), range, file.remarks);
  };
  ImuNoise noise;
  noise.accel_density = noise_at("accel_noise_std", kAccelDensity);
  noise.gyro_density = noise_at("gyro_noise_std", kGyroDensity);
  noise.accel_walk = noise_at("accel_bias_std", kAccelWalk);
  noise.gyro_walk = noise_at("gyro_bias_std", kGyroWalk);
  noise.rate_hz = largest(calibration.at("imu_update_rate"));
  file.imu = noise;
  // Of the rest, what is about the motion capture and the brightness of pictures is of no use here.
  warn_of_unused(calibration,
                 {"T_imu_cam", "intrinsics", "resolution", "cam_time_offset_ns", "accel_noise_std",
                  "gyro_noise_std", "accel_bias_std", "gyro_bias_std", "imu_update_rate", "vignette",
                  "mocap_time_offset_ns", "mocap_to_imu_offset_ns", "T_mocap_world", "T_imu_marker"},
                 file.remarks);
  return file;
}

Camera read_inivation_file(const std::filesystem::path& path) {
  const Xml xml(path);
  const std::string_view all = xml.text();
  const auto matrix_text = xml.element(all, "camera_matrix");
  const auto matrix = xml.numbers(xml.element(matrix_text, "data"));
  const auto lens_text = xml.element(all, "distortion_coefficients");
  auto k = xml.numbers(xml.element(lens_text, "data"));
  const auto number = [&](const char* tag, std::optional<double> missing) {
    const auto text = xml.find(all, tag);
    if (!text && missing) return *missing;
    const auto values = xml.numbers(xml.element(all, tag));
    if (values.size() != 1) xml.refuse(*text, fmt::format("<{}> must be one number", tag));
    return values[0];
  };
  if (matrix.size() != 9) xml.refuse(matrix_text, "camera_matrix must have nine numbers");
  if (!(matrix[0] > 0 && matrix[4] > 0)) xml.refuse(matrix_text, "focal lengths must be positive");
  Camera camera{0, 0, matrix[0], matrix[4], matrix[2], matrix[5], Distortion::kRadTan, {}};
  const auto size = [&](const char* tag) {
    const double value = number(tag, {});
    if (value < 1 || value > 8192 || value != std::floor(value))
      xml.refuse(xml.element(all, tag), fmt::format("<{}> must be a whole number of pixels", tag));
    return static_cast<int>(value);
  };
  camera.width = size("image_width");
  camera.height = size("image_height");
  const bool fisheye = number("use_fisheye_model", 0.0) != 0;
  if (fisheye) camera.distortion = Distortion::kEquidistant;
  const std::size_t most = fisheye ? 4 : 5;
  // OpenCV writes zeros for what its richer models have beyond.
  while (k.size() > most && k.back() == 0) k.pop_back();
  if (k.size() < 4 || k.size() > most)
    xml.refuse(lens_text, fmt::format("{} distortion coefficients where {} are expected", k.size(),
                                      fisheye ? "4" : "4 or 5"));
  std::copy(k.begin(), k.end(), camera.coeffs.begin());
  return camera;
}

}  // namespace idol
