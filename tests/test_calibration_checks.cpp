// What a calibration says that cannot be so, or that this program does not use; and which of its cameras is
// meant.
#include "idol/base/calibration_checks.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "idol/base/calibration_files.hpp"
#include "idol/base/yaml_file.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::expect_says;
using test::TempDir;

std::string camera(const std::string& name, int width, int height, const std::string& more = "") {
  return fmt::format(
      "{}:\n  T_cam_imu:\n  - [1, 0, 0, 0.01]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n"
      "  camera_model: pinhole\n  intrinsics: [200, 200, {}, {}]\n  distortion_model: none\n"
      "  resolution: [{}, {}]\n{}",
      name, width / 2, height / 2, width, height, more);
}

std::string imu(const std::string& more = "") {
  return "accelerometer_noise_density: 0.0039\naccelerometer_random_walk: 0.0003\ngyroscope_noise_density: "
         "0.00017\n"
         "gyroscope_random_walk: 2.0e-05\nupdate_rate: 1000\n" +
         more;
}

Diagnostics remarks_on(const std::string& text, const CameraChoice& choice = {}) {
  return read_calibration(YamlNode::parse(text, "rig.yaml"), choice).remarks;
}

/// The message of a kind; empty: it was not said.
std::string said(const Diagnostics& remarks, const std::string& kind) {
  const auto found = remarks.entries().find(kind);
  return found == remarks.entries().end() ? "" : found->second.first_message;
}

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  text.replace(text.find(what), what.size(), by);
  return text;
}

TEST(CalibrationChecks, AGoodRigSaysNothing) {
  EXPECT_TRUE(remarks_on(camera("cam0", 240, 180,
                                "  timeshift_cam_imu: -0.0024\n  cam_overlaps: [1]\n  rostopic: /e\n") +
                         imu("T_i_b:\n- [1, 0]\n- [0, 1]\ntime_offset: 0.0\nmodel: calibrated\n"))
                  .entries()
                  .empty());
}

TEST(CalibrationChecks, ImplausibleValuesAreNamedWithFileAndLine) {
  const std::string rig = camera("cam0", 240, 180, "  timeshift_cam_imu: 0\n") + imu();
  for (const auto& [what, by, parts] :
       {std::tuple("0.01]", "10.0]", std::vector<std::string>{"rig.yaml:", "T_cam_imu", "mm"}),
        std::tuple("timeshift_cam_imu: 0", "timeshift_cam_imu: -2.4",
                   std::vector<std::string>{"timeshift_cam_imu", "ms"}),
        std::tuple("120, 90", "532, 90", std::vector<std::string>{"intrinsics", "outside the image"}),
        std::tuple("0.00017", "170", std::vector<std::string>{"gyroscope_noise_density", "rad/s"}),
        std::tuple("0.0039", "39", std::vector<std::string>{"accelerometer_noise_density", "m/s^2"})})
    expect_says(said(remarks_on(replaced(rig, what, by)), "implausible_rig"), parts);
  expect_says(said(remarks_on(replaced(rig, "2.0e-05", "0")), "no_random_walk"),
              {"gyroscope_random_walk", "rig.yaml:"});
}

TEST(CalibrationChecks, AZeroRandomWalkIsNotDividedBy) {
  const auto file = read_calibration(YamlNode::parse(replaced(imu(), "0.0003", "0"), "imu.yaml"));
  EXPECT_GT(file.imu->accel_walk, 0);
}

TEST(CalibrationChecks, ContradictingMountingsAreRefused) {
  const std::string other =
      "  T_imu_cam:\n  - [1, 0, 0, 0.01]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n";
  const std::string error = test::error_of(
      [&] { remarks_on(camera("cam0", 240, 180, replaced(other, "0.01]", "0.21]")) + imu()); });
  expect_says(error, {"rig.yaml:", "T_cam_imu", "contradicts"});
  EXPECT_NO_THROW(remarks_on(camera("cam0", 240, 180, replaced(other, "0.01]", "-0.01]")) + imu()));
}

TEST(CalibrationChecks, WhatIsStatedAndNotUsedIsNamed) {
  expect_says(
      said(remarks_on(
               "imu0:\n  T_i_b:\n  - [0, -1, 0]\n  - [1, 0, 0]\n  - [0, 0, 1]\n  time_offset: 0.5\n"
               "  gyroscopes:\n    M:\n    - [0.9, 0, 0]\n    - [0, 1, 0]\n    - [0, 0, 1]\n"
               "  accelerometers:\n    M:\n    - [1, 0]\n    - [0, 1]\n"
               "  accelerometer_noise_density: 0.0039\n  accelerometer_random_walk: 0.0003\n"
               "  gyroscope_noise_density: 0.00017\n  gyroscope_random_walk: 2.0e-05\n  update_rate: 200\n"),
           "unused_calibration"),
      {"rig.yaml:3", "T_i_b, time_offset, gyroscopes:"});
}

TEST(CameraChoice, TheSensorsSizeDecides) {
  const std::string rig = camera("cam0", 752, 480) + camera("cam1", 240, 180);
  const auto width = [&](const CameraChoice& choice) {
    return read_calibration(YamlNode::parse(rig, "rig.yaml"), choice).width;
  };
  const auto size = [](int w, int h) { return [=] { return std::pair(w, h); }; };
  EXPECT_EQ(width({{}, size(240, 180), {}}), 240);
  EXPECT_EQ(width({{}, size(0, 0), size(238, 179)}), 240);
  EXPECT_EQ(width({"cam0", {}, {}}), 752);
  EXPECT_EQ(width({"1", {}, {}}), 240);
  for (const CameraChoice& choice :
       {CameraChoice{}, CameraChoice{{}, size(640, 480), {}}, CameraChoice{"cam7", {}, {}}}) {
    try {
      width(choice);
      FAIL();
    } catch (const UsageError& e) {
      expect_says(e.what(), {"rig.yaml", "cam0 (752 x 480), cam1 (240 x 180)", "--camera"});
    }
  }
}

TEST(CameraChoice, TwoOfOneSizeAreAsked) {
  const std::string rig = camera("cam0", 240, 180) + camera("cam1", 240, 180);
  EXPECT_THROW(remarks_on(rig, {{}, [] { return std::pair(240, 180); }, {}}), UsageError);
}

}  // namespace
}  // namespace idol
