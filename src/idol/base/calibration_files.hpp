// Calibration files, each read for what it holds: Kalibr's (and OpenVINS', which are of the same kind), and
// that of the RPG event-camera recordings. Others: foreign_calibrations.hpp.
#pragma once

#include <filesystem>
#include <optional>
#include <utility>

#include "idol/base/camera.hpp"
#include "idol/base/lie.hpp"
#include "idol/base/rig.hpp"

namespace idol {

class YamlNode;

/// What one file holds of a rig: a camchain, an imu.yaml, or both in one file. Resolution and lens are apart,
/// since a rig file may give the one and leave the other to calib.txt.
struct CalibrationFile {
  std::optional<Camera> camera;  ///< lens; its resolution is 0 x 0 if the file has none
  int width = 0, height = 0;     ///< 0: not in the file
  std::optional<Pose> T_i_c;
  std::optional<double> time_offset_s;
  std::optional<ImuNoise> imu;
  bool approximate = false;  ///< typical of the sensor, not measured on this one
  Diagnostics remarks;       ///< what cannot be right, and what is stated but not used
};

/// Number of pixels, as a whole number. Throws DataError.
int pixels_of(const YamlNode& node);

/// Reads what a file (its root) of Kalibr, OpenVINS or Basalt holds. Throws DataError with file and line for
/// what it holds but makes no sense, UsageError if `choice` does not tell which of its cameras to take.
CalibrationFile read_calibration(const YamlNode& root, const CameraChoice& choice = {});
CalibrationFile read_calibration_file(const std::filesystem::path& path, const CameraChoice& choice = {});

/// RPG calib.txt: fx fy cx cy k1 k2 p1 p2 k3; resolution 0 x 0. Throws DataError.
Camera read_rpg_calibration(const std::filesystem::path& path);

/// Width and height of a PNG file [px], {0, 0} if it is none.
std::pair<int, int> png_size(const std::filesystem::path& path);

}  // namespace idol
