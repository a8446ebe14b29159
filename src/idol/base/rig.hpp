// The rig: camera, IMU noise, and how the two are mounted and clocked relative to each other.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "idol/base/camera.hpp"
#include "idol/base/lie.hpp"

namespace idol {

/// Noise of the IMU in continuous time, as Kalibr's imu.yaml gives it.
struct ImuNoise {
  double gyro_density = 1.7e-4;     ///< [rad/s/sqrt(Hz)]
  double gyro_walk = 2.0e-5;        ///< [rad/s^2/sqrt(Hz)]
  double accel_density = 3.9e-3;    ///< [m/s^2/sqrt(Hz)]
  double accel_walk = 3.0e-4;       ///< [m/s^3/sqrt(Hz)]
  double rate_hz = 1000;            ///< nominal sample rate
};

struct Rig {
  Camera camera;
  Pose T_i_c;                ///< camera in the IMU frame
  ImuNoise imu;
  double time_offset_s = 0;  ///< t_imu = t_camera + time_offset (Kalibr's timeshift_cam_imu)
};

/// Camera of a Kalibr camchain file or an RPG calib.txt (nine numbers; resolution then unknown: 0 x 0).
/// `rig_path` / `imu_path` empty: looked for in the sequence's folder (camchain-imucam.yaml, imu.yaml,
/// calib.txt). Throws DataError with file and line when the result is not a complete rig.
Rig load_rig(const std::filesystem::path& sequence, const std::filesystem::path& rig_path = {},
             const std::filesystem::path& imu_path = {});

/// The camera alone, where a calibration is found in the folder; nullopt if there is none.
std::optional<Camera> find_camera(const std::filesystem::path& sequence, const std::filesystem::path& rig_path = {});

/// The rig as one YAML text that load_rig reads back: Kalibr's camchain keys and imu.yaml's, side by side.
std::string rig_to_yaml(const Rig& rig);

}  // namespace idol
