// Calibrations by other programs than Kalibr: Basalt's calibration.json, iniVation's calibration XML.
#pragma once

#include <filesystem>

#include "idol/base/calibration_files.hpp"

namespace idol {

/// Whether the file is an XML file as OpenCV writes it.
bool is_opencv_xml(const std::filesystem::path& path);

/// Basalt: cameras of type pinhole, kb4 and pinhole-radtan8 (with k4 = k5 = k6 = 0).
CalibrationFile read_basalt_file(const YamlNode& root, const CameraChoice& choice);

/// iniVation (DV): the lens of the first camera in the file and its resolution. Throws DataError with file
/// and line.
Camera read_inivation_file(const std::filesystem::path& path);

}  // namespace idol
