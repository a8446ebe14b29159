// What a calibration file says and cannot be so, what it says and this program does not use, and which of its
// cameras is the recording's.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/lie.hpp"
#include "idol/base/rig.hpp"

namespace idol {

class YamlNode;

/// Each warns of a value that no real rig has, naming file, line, key and unit.
void check_lever_arm(const YamlNode& node, const Pose& T_i_c, Diagnostics& remarks);
void check_time_shift(const YamlNode& node, double seconds, Diagnostics& remarks);
void check_centre(const YamlNode& node, const Camera& camera, Diagnostics& remarks);

/// One number of the IMU's noise and what is usual for it.
struct NoiseRange {
  double least, most;
  const char* unit;
};
constexpr NoiseRange kGyroDensity{1e-7, 0.1, "rad/s/sqrt(Hz)"}, kGyroWalk{1e-10, 0.05, "rad/s^2/sqrt(Hz)"},
    kAccelDensity{1e-6, 2.0, "m/s^2/sqrt(Hz)"}, kAccelWalk{1e-9, 1.0, "m/s^3/sqrt(Hz)"};
/// The value, or the least of the range for a zero, which would be divided by. Warns of both that and of
/// values beyond the range, which spans what is sold.
double checked_noise(const YamlNode& node, double value, const NoiseRange& range, Diagnostics& remarks);

/// Warns, in one message, of all keys of `map` that are not `used` and state something: neither text, nor
/// zero, nor an identity. What corrects the readings and is left out makes them wrong.
void warn_of_unused(const YamlNode& map, const std::set<std::string>& used, Diagnostics& remarks);

/// A camera of a rig file; the size is 0 x 0 where it is not said.
struct ListedCamera {
  std::string name;
  int width = 0, height = 0;
};
/// Index of the camera to take: the one that `choice` names, the only one, or the only one of the sensor's
/// size. Says in `remarks` which of several it is. Throws UsageError, listing all, if that does not settle
/// it.
std::size_t choose_camera(const std::string& file, const std::vector<ListedCamera>& cameras,
                          const CameraChoice& choice, Diagnostics& remarks);

}  // namespace idol
