// The rig: camera, IMU noise, and how the two are mounted and clocked relative to each other.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/lie.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Noise of the IMU in continuous time, as Kalibr's imu.yaml gives it.
struct ImuNoise {
  double gyro_density = 1.7e-4;   ///< [rad/s/sqrt(Hz)]
  double gyro_walk = 2.0e-5;      ///< [rad/s^2/sqrt(Hz)]
  double accel_density = 3.9e-3;  ///< [m/s^2/sqrt(Hz)]
  double accel_walk = 3.0e-4;     ///< [m/s^3/sqrt(Hz)]
  double rate_hz = 1000;          ///< nominal sample rate
};

struct Rig {
  Camera camera;
  Pose T_i_c;  ///< camera in the IMU frame
  ImuNoise imu;
  double time_offset_s = 0;  ///< t_imu = t_camera + time_offset (Kalibr's timeshift_cam_imu)
};

/// What the gyro says of the camera, at the samples' own stamps and with the gyro's bias in it: for those
/// whom only its changes matter.
std::vector<CameraRate> camera_rates(std::span<const ImuSample> samples, const Rig& rig);

/// To be asked for the width and height that a recording states itself, {0, 0} if it does not.
using StatedSize = std::function<std::pair<int, int>()>;

/// Which camera of a rig file that describes several.
struct CameraChoice {
  std::string name = {};   ///< cam1, or its number; empty: the one of the sensor's size
  StatedSize stated = {};  ///< may be empty
  StatedSize seen = {};  ///< of a recording that does not state its size: what its events fill; may be empty
};

/// The rig of a recording. `rig_path` is a Kalibr camchain-imucam.yaml (of several cameras in it, `camera`
/// decides; it may hold imu.yaml's keys too), a file of OpenVINS or Basalt, or a lens alone: an RPG calib.txt
/// or iniVation's calibration XML; or the name of a ready rig (ready_rigs.hpp). `imu_path` is a Kalibr
/// imu.yaml. What they leave open is looked for in the sequence's folder. The camera of `rig_path` comes
/// first (unless it is approximate), then that of the folder's camchain, then calib.txt, which knows no
/// resolution: it is taken from the camchain, else from the first PNG below images/, else it is 240 x 180,
/// with a warning, if the principal point fits that sensor (within 30 px of its centre). With `stated` a rig
/// may be assumed, with a warning: where nothing says how camera and IMU are mounted but the sensor is a
/// DAVIS240C by its size (and lens, if there is one), that of the RPG dataset. Throws DataError with file and
/// line when the result is not a complete and sensible rig.
Rig load_rig(const std::filesystem::path& sequence, const std::filesystem::path& rig_path = {},
             const std::filesystem::path& imu_path = {}, Diagnostics* diagnostics = nullptr,
             const StatedSize& stated = {}, const CameraChoice& camera = {});

/// The calibration files that load_rig reads for a recording. Throws DataError as it does for missing ones.
std::vector<std::filesystem::path> rig_files(const std::filesystem::path& sequence,
                                             const std::filesystem::path& rig_path);

/// The camera alone, by the same rules; nullopt if there is no calibration. Its resolution is 0 x 0 if
/// unknown.
std::optional<Camera> find_camera(const std::filesystem::path& sequence,
                                  const std::filesystem::path& rig_path = {},
                                  Diagnostics* diagnostics = nullptr, const CameraChoice& choice = {});

/// The rig as one YAML text that load_rig reads back: Kalibr's camchain keys and imu.yaml's, side by side.
std::string rig_to_yaml(const Rig& rig);

}  // namespace idol
