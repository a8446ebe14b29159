#include "idol/base/calibration_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/yaml_file.hpp"

namespace idol {
namespace {

std::string listed(const ListedCamera& camera) {
  return camera.width > 0 ? fmt::format("{} ({} x {})", camera.name, camera.width, camera.height)
                          : camera.name;
}

std::string list_of(const std::vector<ListedCamera>& cameras) {
  std::string text;
  for (const ListedCamera& camera : cameras) text += (text.empty() ? "" : ", ") + listed(camera);
  return text;
}

/// cam1, by its name or its number.
bool is_named(const ListedCamera& camera, const std::string& name) {
  return camera.name == name || camera.name == "cam" + name;
}

/// Whether the events of a sensor whose outermost pixels seen make `size` may be this camera's.
bool may_be(const ListedCamera& camera, std::pair<int, int> size, bool stated) {
  if (stated) return camera.width == size.first && camera.height == size.second;
  constexpr double kLeastShare = 0.75;  // of a side: events of a whole sensor reach its borders
  return size.first <= camera.width && size.second <= camera.height &&
         size.first >= kLeastShare * camera.width && size.second >= kLeastShare * camera.height;
}

/// Nothing that would change a reading.
bool is_neutral(const YamlNode& node) {
  if (node.is_map()) {
    const auto keys = node.keys();
    return std::all_of(keys.begin(), keys.end(),
                       [&](const std::string& key) { return is_neutral(node.at(key)); });
  }
  if (!node.is_list()) {
    const auto number = node.try_number();
    return !number || *number == 0;
  }
  const auto rows = node.items();
  bool zero = true, identity = true;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    if (!rows[r].is_list()) {
      zero = zero && is_neutral(rows[r]);
      identity = false;
      continue;
    }
    const auto row = rows[r].items();
    for (std::size_t c = 0; c < row.size(); ++c) {
      const double value = row[c].try_number().value_or(0);
      zero = zero && value == 0;
      identity = identity && value == (r == c ? 1 : 0);
    }
  }
  return zero || identity;
}

}  // namespace

void check_lever_arm(const YamlNode& node, const Pose& T_i_c, Diagnostics& remarks) {
  constexpr double kLongest = 2;  // [m]
  if (const double metres = T_i_c.p.norm(); metres > kLongest)
    remarks.warn(
        "implausible_rig",
        fmt::format("{}: {}: camera and IMU would be {:.3g} m apart; metres are expected: are these mm?",
                    node.where(), node.key(), metres));
}

void check_time_shift(const YamlNode& node, double seconds, Diagnostics& remarks) {
  constexpr double kLongest = 0.1;  // [s]
  if (std::abs(seconds) > kLongest)
    remarks.warn(
        "implausible_rig",
        fmt::format("{}: {}: the clocks would be {:.3g} s apart; seconds are expected: are these ms?",
                    node.where(), node.key(), seconds));
}

void check_centre(const YamlNode& node, const Camera& camera, Diagnostics& remarks) {
  if (camera.width <= 0) return;
  if (camera.cx >= 0 && camera.cy >= 0 && camera.cx <= camera.width && camera.cy <= camera.height) return;
  remarks.warn(
      "implausible_rig",
      fmt::format("{}: {}: the principal point ({:.4g}, {:.4g}) px lies outside the image of {} x {}; are "
                  "lens and resolution of one camera?",
                  node.where(), node.key(), camera.cx, camera.cy, camera.width, camera.height));
}

double checked_noise(const YamlNode& node, double value, const NoiseRange& range, Diagnostics& remarks) {
  if (value == 0) {
    remarks.warn(
        "no_random_walk",
        fmt::format("{}: {}: zero says that the bias never moves, which no IMU keeps; {} {} is taken",
                    node.where(), node.key(), range.least, range.unit));
    return range.least;
  }
  if (value < range.least || value > range.most)
    remarks.warn("implausible_rig",
                 fmt::format("{}: {}: {:.3g} is far from any sensor's ({:.0e} to {:.0e}); is it in {}?",
                             node.where(), node.key(), value, range.least, range.most, range.unit));
  return value;
}

void warn_of_unused(const YamlNode& map, const std::set<std::string>& used, Diagnostics& remarks) {
  std::string names, where;
  for (const std::string& key : map.keys()) {
    if (used.contains(key)) continue;
    const YamlNode value = map.at(key);
    if (is_neutral(value)) continue;
    if (where.empty()) where = value.where();
    names += fmt::format("{}{}", names.empty() ? "" : ", ", printable(key));
  }
  if (names.empty()) return;
  remarks.warn(
      "unused_calibration",
      fmt::format("{}: {}: stated here, but not used: readings that need it must be corrected before", where,
                  names));
}

std::size_t choose_camera(const std::string& file, const std::vector<ListedCamera>& cameras,
                          const CameraChoice& choice, Diagnostics& remarks) {
  if (!choice.name.empty()) {
    for (std::size_t i = 0; i < cameras.size(); ++i)
      if (is_named(cameras[i], choice.name)) return i;
    throw UsageError(
        fmt::format("{}: --camera '{}' is none of: {}", file, printable(choice.name), list_of(cameras)));
  }
  if (cameras.size() == 1) return 0;
  std::pair<int, int> size = choice.stated ? choice.stated() : std::pair(0, 0);
  const bool stated = size.first > 0;
  if (!stated && choice.seen) size = choice.seen();
  std::vector<std::size_t> fitting;
  for (std::size_t i = 0; i < cameras.size() && size.first > 0; ++i)
    if (may_be(cameras[i], size, stated)) fitting.push_back(i);
  const std::string sensor = size.first > 0 ? fmt::format("the events are of {}{} x {} pixels",
                                                          stated ? "" : "up to ", size.first, size.second)
                                            : "of which size the sensor is, is not known";
  if (fitting.size() != 1)
    throw UsageError(fmt::format("{}: {} cameras: {}; {}: choose with --camera NAME", file, cameras.size(),
                                 list_of(cameras), sensor));
  remarks.warn("camera_chosen", fmt::format("{}: {} is taken of {}: {}; --camera NAME takes another", file,
                                            cameras[fitting[0]].name, list_of(cameras), sensor));
  return fitting[0];
}

}  // namespace idol
