#include "idol/base/rig.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <tuple>

#include "idol/base/calibration_files.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/foreign_calibrations.hpp"
#include "idol/base/ready_rigs.hpp"
#include "idol/base/yaml_file.hpp"

namespace idol {

namespace fs = std::filesystem;

namespace {

/// The files that describe a recording's rig: one of a whole rig, with what it holds, and one of the lens
/// alone.
struct Sources {
  fs::path folder;
  fs::path rig_path;   ///< Kalibr's or its like; empty: none
  fs::path lens_path;  ///< RPG's or iniVation's; empty: none
  bool lens_first = false;
  const ReadyRig* ready = nullptr;  ///< instead of a file
  CalibrationFile rig;
};

/// An RPG calibration starts with a number, a YAML file with a key.
bool is_rpg_calibration(const fs::path& path) {
  std::ifstream in(path);
  std::string word;
  return static_cast<bool>(in >> word) && word.find_first_not_of("0123456789+-.eE,") == std::string::npos;
}

const ReadyRig* find_ready_rig(const fs::path& name) {
  const auto rigs = ready_rigs();
  const auto found =
      std::find_if(rigs.begin(), rigs.end(), [&](const ReadyRig& r) { return r.name == name; });
  return found == rigs.end() ? nullptr : &*found;
}

CalibrationFile read_ready_rig(const ReadyRig& ready) {
  const std::string name(ready.name);
  return read_calibration(YamlNode::parse(std::string(ready.yaml), name));
}

std::string names_of_ready_rigs() {
  std::string names;
  for (const ReadyRig& ready : ready_rigs())
    names += fmt::format("{}{}", names.empty() ? "" : ", ", ready.name);
  return names;
}

/// The only file in the folder that is called as Kalibr calls its results after a bag; empty: none. Throws
/// DataError if there are several.
fs::path find_named_after_bag(const fs::path& folder, bool (*is_it)(const std::string&), const char* option) {
  std::vector<fs::path> found;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? "." : folder, none)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with('.') && name.ends_with(".yaml") && is_it(name)) found.push_back(entry.path());
  }
  if (found.empty()) return {};
  std::sort(found.begin(), found.end());
  if (found.size() > 1)
    throw DataError(fmt::format("{}: {} lies beside it; give the one to read with {}", found[0].string(),
                                found[1].filename().string(), option));
  return found[0];
}

bool is_camchain(const std::string& name) {
  return name.find("camchain-imucam") != std::string::npos ||
         name.find("camchain_imucam") != std::string::npos;
}
bool is_imu_file(const std::string& name) {
  return name.find("imu") != std::string::npos && name.find("cam") == std::string::npos;
}

/// Where they are; none is read.
Sources locate_sources(const fs::path& sequence, const fs::path& rig_path) {
  Sources sources;
  sources.folder = fs::is_directory(sequence) ? sequence : sequence.parent_path();
  const ReadyRig* ready = fs::exists(rig_path) ? nullptr : find_ready_rig(rig_path);
  sources.ready = ready;
  if (!rig_path.empty()) {
    if (ready == nullptr && fs::exists(rig_path) && !fs::is_regular_file(rig_path))
      throw DataError(fmt::format("{}: is no regular file; a rig is read more than once: write it to a file",
                                  rig_path.string()));
    if (ready == nullptr && !fs::is_regular_file(rig_path))
      throw DataError(fmt::format("{}: no such rig file, and none of the ready rigs: {}", rig_path.string(),
                                  names_of_ready_rigs()));
    sources.lens_first = ready == nullptr && (is_rpg_calibration(rig_path) || is_opencv_xml(rig_path));
    (sources.lens_first ? sources.lens_path : sources.rig_path) = rig_path;
  }
  const auto take = [&](fs::path& place, const char* name) {
    if (place.empty() && fs::exists(sources.folder / name)) place = sources.folder / name;
  };
  for (const char* name : {"camchain-imucam.yaml", "kalibr_imucam_chain.yaml", "calibration.json"})
    take(sources.rig_path, name);
  if (sources.rig_path.empty() && ready == nullptr)
    sources.rig_path = find_named_after_bag(sources.folder, is_camchain, "--rig");
  for (const char* name : {"calib.txt", "calibration.xml"}) take(sources.lens_path, name);
  return sources;
}

Sources find_sources(const fs::path& sequence, const fs::path& rig_path, const CameraChoice& choice) {
  Sources sources = locate_sources(sequence, rig_path);
  if (sources.ready != nullptr) {
    sources.rig = read_ready_rig(*sources.ready);
  } else if (!sources.rig_path.empty()) {
    sources.rig = read_calibration_file(sources.rig_path, choice);
  }
  return sources;
}

bool may_be_one_lens(const Camera& a, const Camera& b) {
  constexpr double kTolerance = 0.1;  // far more than two calibrations of one lens differ by
  return std::abs(a.fx / b.fx - 1) < kTolerance && std::abs(a.fy / b.fy - 1) < kTolerance;
}

/// Two calibrations that cannot be of the same lens: better asked than guessed.
void check_agreement(const Sources& sources, const Camera& a, const Camera& b) {
  if (may_be_one_lens(a, b)) return;
  throw DataError(
      fmt::format("{}: focal length {:.1f} px, but {:.1f} px in {}; take the lens (intrinsics, "
                  "distortion_*) out of the rig file to use calib.txt, or give a rig file of this camera",
                  sources.rig_path.string(), a.fx, b.fx, sources.lens_path.string()));
}

void find_resolution(const Sources& sources, Camera& camera, Diagnostics* diagnostics) {
  camera.width = sources.rig.width;
  camera.height = sources.rig.height;
  if (camera.width > 0) return;
  fs::path first;
  std::error_code no_images;
  for (const auto& entry : fs::directory_iterator(sources.folder / "images", no_images))
    if (entry.path().extension() == ".png" && (first.empty() || entry.path() < first)) first = entry.path();
  if (!first.empty()) std::tie(camera.width, camera.height) = png_size(first);
  if (camera.width > 0) return;
  constexpr int kDavis240Width = 240;
  constexpr int kDavis240Height = 180;
  constexpr double kLargestOffset = 30;  // [px]; no other common sensor has its centre so near
  if (std::abs(camera.cx - 0.5 * kDavis240Width) > kLargestOffset) return;
  if (std::abs(camera.cy - 0.5 * kDavis240Height) > kLargestOffset) return;
  camera.width = kDavis240Width;
  camera.height = kDavis240Height;
  if (diagnostics == nullptr) return;
  diagnostics->warn(
      "assumed_resolution",
      fmt::format("{}: says nothing of the resolution; 240 x 180 assumed from the principal point. A "
                  "rig file with 'resolution' under 'cam0' settles it",
                  sources.lens_path.string()));
}

std::optional<Camera> lens_of(const Sources& sources) {
  if (sources.lens_path.empty()) return std::nullopt;
  return is_opencv_xml(sources.lens_path) ? read_inivation_file(sources.lens_path)
                                          : read_rpg_calibration(sources.lens_path);
}

std::optional<Camera> camera_of(const Sources& sources, Diagnostics* diagnostics) {
  const std::optional<Camera> lens = lens_of(sources);
  std::optional<Camera> camera = sources.rig.camera;
  fs::path path = sources.rig_path;
  const bool lens_first = sources.lens_first || sources.rig.approximate;
  if (lens && camera && !lens_first) check_agreement(sources, *camera, *lens);
  if (lens && (!camera || lens_first)) {
    camera = lens;
    path = sources.lens_path;
  }
  if (!camera) return std::nullopt;
  if (camera->width == 0) find_resolution(sources, *camera, diagnostics);
  if (camera->width == 0) return camera;
  camera->check(path.string());
  try {
    for (const double x : {0, camera->width - 1})
      for (const double y : {0, camera->height - 1}) static_cast<void>(camera->undistort({x, y}));
  } catch (const DataError& e) {
    throw DataError(fmt::format("{}: {}", path.string(), e.what()));
  }
  return camera;
}

/// An IMU's noise that lies beside the recording or the rig file; empty: none.
fs::path imu_file_of(const Sources& sources) {
  for (const fs::path& folder : {sources.folder, sources.rig_path.parent_path()})
    for (const char* name : {"imu.yaml", "kalibr_imu_chain.yaml"})
      if (fs::exists(folder / name)) return folder / name;
  return find_named_after_bag(sources.folder, is_imu_file, "--imu-rig");
}

ImuNoise imu_of(const Sources& sources, const fs::path& imu_path, Diagnostics* diagnostics) {
  const auto read = [&](const fs::path& path) {
    const CalibrationFile file = read_calibration_file(path);
    if (!file.imu) {
      throw DataError(
          fmt::format("{}:1: no IMU noise in this file (accelerometer_noise_density and the other keys of "
                      "Kalibr's imu.yaml)",
                      path.string()));
    }
    if (diagnostics != nullptr) diagnostics->merge(file.remarks);
    return *file.imu;
  };
  if (!imu_path.empty()) return read(imu_path);
  if (sources.rig.imu) return *sources.rig.imu;
  if (const fs::path beside = imu_file_of(sources); !beside.empty()) return read(beside);
  throw DataError(
      fmt::format("{}: no IMU noise: neither here nor in an imu.yaml beside the recording; give Kalibr's "
                  "imu.yaml with --imu-rig, or add its keys to this file",
                  sources.rig_path.string()));
}

/// The recordings of the RPG dataset come with a lens (folders) or nothing (bags), and all have one rig.
void assume_rpg_rig(Sources& sources, const StatedSize& stated, Diagnostics* diagnostics) {
  if (!sources.rig_path.empty() || !stated) return;
  const ReadyRig& ready = *find_ready_rig("davis240c");
  CalibrationFile rig = read_ready_rig(ready);
  std::pair<int, int> size = stated();
  std::optional<Camera> lens = lens_of(sources);
  if (lens) {
    if (lens->width == 0) find_resolution(sources, *lens, nullptr);
    size = {lens->width, lens->height};
    if (!may_be_one_lens(*rig.camera, *lens)) return;
    rig.camera.reset();
  }
  if (size != std::pair(rig.width, rig.height)) return;
  sources.rig = rig;
  sources.rig_path = ready.name;
  if (diagnostics == nullptr) return;
  diagnostics->warn(
      "assumed_rig",
      fmt::format("{}: no calibration says how {}; the sensor is a DAVIS240C, so the rig of the "
                  "RPG dataset is taken (--rig davis240c). Of another camera, give its own",
                  sources.folder.empty() ? "." : sources.folder.string(),
                  lens ? "camera and IMU are mounted" : "camera and IMU are made and mounted"));
}

/// An approximate rig to begin with, if there is one for this sensor.
std::string advice_for(const StatedSize& stated) {
  const std::pair<int, int> size = stated ? stated() : std::pair(0, 0);
  for (const ReadyRig& ready : ready_rigs())
    if (const CalibrationFile rig = read_ready_rig(ready);
        rig.approximate && size == std::pair(rig.width, rig.height))
      return fmt::format("; to begin with, --rig {} is an approximate one for its {} x {} pixels", ready.name,
                         size.first, size.second);
  return "";
}

}  // namespace

std::vector<CameraRate> camera_rates(std::span<const ImuSample> samples, const Rig& rig) {
  std::vector<CameraRate> out;
  out.reserve(samples.size());
  const Mat3 R_c_i = rig.T_i_c.q.conjugate().toRotationMatrix();
  for (const ImuSample& s : samples) out.push_back({s.t, R_c_i * s.gyro});
  return out;
}

Rig load_rig(const fs::path& sequence, const fs::path& rig_path, const fs::path& imu_path,
             Diagnostics* diagnostics, const StatedSize& stated, const CameraChoice& choice) {
  Sources sources = find_sources(sequence, rig_path, choice);
  assume_rpg_rig(sources, stated, diagnostics);
  if (sources.rig_path.empty() && sources.lens_path.empty()) {
    throw DataError(
        fmt::format("{}: no calibration here (camchain-imucam.yaml, or calib.txt for the camera); give a "
                    "rig file with --rig{}",
                    sources.folder.string(), advice_for(stated)));
  }
  if (!sources.rig.T_i_c) {
    const fs::path& path = sources.rig_path.empty() ? sources.lens_path : sources.rig_path;
    throw DataError(
        fmt::format("{}:1: no extrinsics: where the camera sits on the IMU (cam0: T_cam_imu) is not said; "
                    "give a rig file that has it with --rig{}",
                    path.string(), sources.rig_path.empty() ? advice_for(stated) : ""));
  }
  Rig rig;
  rig.T_i_c = *sources.rig.T_i_c;
  rig.time_offset_s = sources.rig.time_offset_s.value_or(0.0);
  const std::optional<Camera> camera = camera_of(sources, diagnostics);
  if (!camera) {
    throw DataError(
        fmt::format("{}:1: no lens: neither 'intrinsics' under 'cam0' nor a calib.txt beside the recording",
                    sources.rig_path.string()));
  }
  if (camera->width == 0) {
    throw DataError(
        fmt::format("{}:1: the sensor's resolution is not known; add 'resolution: [width, height]' under "
                    "'cam0'",
                    sources.rig_path.string()));
  }
  rig.camera = *camera;
  if (sources.rig.approximate && diagnostics != nullptr)
    diagnostics->warn(
        "approximate_rig",
        fmt::format("{}: typical of this sensor, not measured on yours: expect a trajectory of roughly "
                    "the right shape, and calibrate for more",
                    sources.rig_path.string()));
  if (diagnostics != nullptr) diagnostics->merge(sources.rig.remarks);
  rig.imu = imu_of(sources, imu_path, diagnostics);
  return rig;
}

std::vector<fs::path> rig_files(const fs::path& sequence, const fs::path& rig_path) {
  const Sources sources = locate_sources(sequence, rig_path);
  return {sources.rig_path, sources.lens_path, imu_file_of(sources)};
}

std::optional<Camera> find_camera(const fs::path& sequence, const fs::path& rig_path,
                                  Diagnostics* diagnostics, const CameraChoice& choice) {
  return camera_of(find_sources(sequence, rig_path, choice), diagnostics);
}

std::string rig_to_yaml(const Rig& rig) {
  const Camera& c = rig.camera;
  const Pose T_c_i = rig.T_i_c.inverse();
  const Mat3 R = T_c_i.R();
  std::string text =
      "# t_imu = t_camera + timeshift_cam_imu; T_cam_imu maps points of the IMU to the camera\ncam0:\n";
  text += "  T_cam_imu:\n";
  for (int r = 0; r < 3; ++r)
    text += fmt::format("  - [{}, {}, {}, {}]\n", R(r, 0), R(r, 1), R(r, 2), T_c_i.p[r]);
  text += "  - [0, 0, 0, 1]\n  camera_model: pinhole\n";
  text += fmt::format("  intrinsics: [{}, {}, {}, {}]\n", c.fx, c.fy, c.cx, c.cy);
  const auto& k = c.coeffs;
  switch (c.distortion) {
    case Distortion::kNone:
      text += "  distortion_model: none\n  distortion_coeffs: []\n";
      break;
    case Distortion::kRadTan:
      text += "  distortion_model: radtan\n";
      text += fmt::format("  distortion_coeffs: [{}, {}, {}, {}, {}]\n", k[0], k[1], k[2], k[3], k[4]);
      break;
    case Distortion::kEquidistant:
      text += "  distortion_model: equidistant\n";
      text += fmt::format("  distortion_coeffs: [{}, {}, {}, {}]\n", k[0], k[1], k[2], k[3]);
      break;
  }
  text +=
      fmt::format("  resolution: [{}, {}]\n  timeshift_cam_imu: {}\n", c.width, c.height, rig.time_offset_s);
  text += fmt::format("accelerometer_noise_density: {}\naccelerometer_random_walk: {}\n",
                      rig.imu.accel_density, rig.imu.accel_walk);
  text += fmt::format("gyroscope_noise_density: {}\ngyroscope_random_walk: {}\nupdate_rate: {}\n",
                      rig.imu.gyro_density, rig.imu.gyro_walk, rig.imu.rate_hz);
  return text;
}

}  // namespace idol
