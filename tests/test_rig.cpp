#include "idol/base/rig.hpp"

#include <fmt/format.h>

#include <sstream>

#include "idol/base/ready_rigs.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::error_of;
using test::expect_says;
using test::TempDir;

const std::string kLens = R"(  camera_model: pinhole
  distortion_coeffs: [-0.36, 0.15, -0.0003, -0.0007]
  distortion_model: radtan
  intrinsics: [199.5, 198.5, 132.25, 110.75]
)";
const std::string kMount = R"(  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.1]
  - [-1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
)";
const std::string kRest = "  resolution: [240, 180]\n  timeshift_cam_imu: 0.0025\n";
const std::string kImu = R"(accelerometer_noise_density: 1.0e-02
accelerometer_random_walk: 0.0
gyroscope_noise_density: 2.0e-03
gyroscope_random_walk: 3.0e-05
update_rate: 200.0
)";
const std::string kRpg = "199.5 198.5 132.25 110.75 -0.36 0.15 -0.0003 -0.0007 0.0\n";

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const auto at = text.find(what);
  EXPECT_NE(at, std::string::npos) << what;
  return text.replace(at, what.size(), by);
}

void expect_the_rig(const Rig& rig) {
  EXPECT_EQ(rig.camera.width, 240);
  EXPECT_EQ(rig.camera.height, 180);
  EXPECT_EQ(rig.camera.fx, 199.5);
  EXPECT_EQ(rig.camera.cy, 110.75);
  EXPECT_EQ(rig.camera.distortion, Distortion::kRadTan);
  EXPECT_EQ(rig.camera.coeffs[3], -0.0007);
  EXPECT_EQ(rig.time_offset_s, 0.0025);
  EXPECT_EQ(rig.imu.accel_density, 1e-2);
  EXPECT_EQ(rig.imu.gyro_walk, 3e-5);
  EXPECT_EQ(rig.imu.rate_hz, 200);
  // A point at the IMU's origin is at T_cam_imu's translation in the camera.
  EXPECT_LT((rig.T_i_c * Vec3(0.1, 0.2, 0.3)).norm(), 1e-12);
  EXPECT_LT((rig.T_i_c.inverse() * Vec3(1, 0, 0) - Vec3(0.1, -0.8, 0.3)).norm(), 1e-12);
}

TEST(Rig, KalibrFilesOfTheFolder) {
  const TempDir dir;
  dir.write("camchain-imucam.yaml", "cam0:\n" + kMount + kLens + kRest);
  dir.write("imu.yaml", kImu);
  expect_the_rig(load_rig(dir.path()));
  expect_the_rig(load_rig(dir.path() / "events.txt"));
  dir.write("imu.yaml",
            "imu0:\n  " + replaced(replaced(replaced(replaced(kImu, "\nacc", "\n  acc"), "\ngyr", "\n  gyr"),
                                            "\ngyroscope_r", "\n  gyroscope_r"),
                                   "\nupd", "\n  upd"));
  expect_the_rig(load_rig(dir.path()));
}

TEST(Rig, OneFileWithBothAndFilesByPath) {
  const TempDir dir;
  const TempDir elsewhere;
  expect_the_rig(
      load_rig(dir.path(), elsewhere.write("both.yaml", "cam0:\n" + kMount + kLens + kRest + kImu)));
  const auto chain = elsewhere.write("chain.yaml", "cam0:\n" + kMount + kLens + kRest);
  expect_the_rig(load_rig(dir.path(), chain, elsewhere.write("noise.yaml", kImu)));
  expect_says(error_of([&] { load_rig(dir.path(), elsewhere.path() / "absent.yaml"); }),
              {"absent.yaml", "no such"});
  expect_says(error_of([&] { load_rig(dir.path(), chain, elsewhere.path() / "absent.yaml"); }),
              {"absent.yaml"});
}

TEST(Rig, RpgCalibrationForTheLensAndARigFileForTheRest) {
  const TempDir dir;
  const TempDir elsewhere;
  dir.write("calib.txt", kRpg);
  expect_the_rig(load_rig(dir.path(), elsewhere.write("rest.yaml", "cam0:\n" + kMount + kRest + kImu)));
  // A rig file with another lens must not win silently, nor lose.
  const std::string other = replaced(kLens, "199.5, 198.5", "335.0, 335.0");
  expect_says(error_of([&] {
                load_rig(dir.path(), elsewhere.write("o.yaml", "cam0:\n" + kMount + other + kRest + kImu));
              }),
              {"o.yaml", "335.0", "199.5", "calib.txt"});
}

TEST(Rig, ResolutionOfAnRpgCalibration) {
  const TempDir dir;
  dir.write("calib.txt", kRpg);
  Diagnostics diagnostics;
  const auto assumed = find_camera(dir.path(), {}, &diagnostics);
  EXPECT_EQ(assumed->width, 240);
  EXPECT_EQ(diagnostics.entries().count("assumed_resolution"), 1u);

  dir.write("calib.txt", replaced(kRpg, "132.25 110.75", "170 130"));
  EXPECT_EQ(find_camera(dir.path())->width, 0);
  const auto rig = dir.write("rest.yaml", "cam0:\n" + kMount + kImu);
  expect_says(error_of([&] { load_rig(dir.path(), rig); }), {"resolution"});
  std::filesystem::create_directory(dir.path() / "images");
  dir.write("images/frame_0.png", std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\x5a\0\0\x01\x04", 24));
  EXPECT_EQ(load_rig(dir.path(), rig).camera.width, 346);
  EXPECT_EQ(load_rig(dir.path(), rig).camera.height, 260);
  dir.write("rest.yaml", "cam0:\n" + kMount + "  resolution: [320, 240]\n" + kImu);
  EXPECT_EQ(load_rig(dir.path(), rig).camera.width, 320);
}

TEST(Rig, CameraAlone) {
  const TempDir dir;
  EXPECT_EQ(find_camera(dir.path()), std::nullopt);
  const TempDir elsewhere;
  const auto rpg = elsewhere.write("my_calib.txt", kRpg);
  EXPECT_EQ(find_camera(dir.path(), rpg)->fx, 199.5);
  EXPECT_EQ(find_camera(dir.path(), elsewhere.write("c.yaml", "cam0:\n" + kLens + kRest))->cx, 132.25);
}

TEST(Rig, IncompleteRigsSayWhatIsMissing) {
  const TempDir dir;
  expect_says(error_of([&] { load_rig(dir.path()); }), {"no calibration", "--rig"});
  dir.write("calib.txt", kRpg);
  expect_says(error_of([&] { load_rig(dir.path()); }), {"calib.txt", "no extrinsics", "--rig"});
  dir.write("camchain-imucam.yaml", "cam0:\n" + kLens + kRest);
  expect_says(error_of([&] { load_rig(dir.path()); }),
              {"camchain-imucam.yaml", "no extrinsics", "T_cam_imu"});
  dir.write("camchain-imucam.yaml", "cam0:\n" + kMount + kLens + kRest);
  expect_says(error_of([&] { load_rig(dir.path()); }), {"no IMU noise", "--imu-rig"});
  dir.write("imu.yaml", replaced(kImu, "update_rate", "update_weight"));
  expect_says(error_of([&] { load_rig(dir.path()); }), {"imu.yaml:1", "update_rate"});
}

TEST(Rig, DamagedFilesNameFileAndLine) {
  const TempDir dir;
  dir.write("imu.yaml", kImu);
  const std::string good = "cam0:\n" + kMount + kLens + kRest;
  const auto error = [&](const std::string& what, const std::string& by) {
    dir.write("camchain-imucam.yaml", replaced(good, what, by));
    return error_of([&] { load_rig(dir.path()); });
  };
  const std::string name = "camchain-imucam.yaml";
  expect_says(error("  - [0.0, 0.0, 0.0, 1.0]\n", ""), {name + ":3", "3 rows"});
  expect_says(error("[-1.0, 0.0, 0.0, 0.2]", "[-1.0, 0.0, 0.2]"), {name + ":4", "3 columns"});
  expect_says(error("[-1.0, 0.0, 0.0, 0.2]", "[-1.0, 0.1, 0.0, 0.2]"), {name + ":3", "not a rotation"});
  expect_says(error("[-1.0, 0.0, 0.0, 0.2]", "[1.0, 0.0, 0.0, 0.2]"), {name + ":3", "mirrored"});
  expect_says(error("[-1.0, 0.0, 0.0, 0.2]", "[-1.0, 0.0, .nan, 0.2]"), {name + ":4", "'.nan'", "finite"});
  expect_says(error("0.0, 1.0]\n  camera", "0.5, 1.0]\n  camera"), {name + ":3", "last row"});
  expect_says(error("pinhole", "omni"), {name + ":7", "'omni' is not supported"});
  expect_says(error("radtan", "fov"), {name + ":9", "'fov' is not supported"});
  expect_says(error("[199.5, 198.5, 132.25, 110.75]", "[199.5, 198.5, 132.25]"), {name + ":10", "3 numbers"});
  expect_says(error("199.5", "-199.5"), {name + ":10", "positive"});
  expect_says(error("-0.0003, -0.0007", "-0.0003"), {name + ":8", "3 numbers"});
  expect_says(error("-0.36", "-9"), {name, "lens model"});
  expect_says(error("[240, 180]", "[240.5, 180]"), {name + ":11", "resolution"});
  expect_says(error("0.0025", "soon"), {name + ":12", "'soon'"});
  expect_says(error("[240, 180]", "[240, 180"), {name, "YAML"});
  expect_says(error("cam0:", "lens0:"), {name, "cam0"});
  dir.write("camchain-imucam.yaml", "");
  expect_says(error_of([&] { load_rig(dir.path()); }), {name, "empty"});
  dir.write("camchain-imucam.yaml", std::string("\0\x01\x02\xff\xfe", 5));
  expect_says(error_of([&] { load_rig(dir.path()); }), {name});
}

TEST(Rig, DamagedRpgCalibration) {
  const TempDir dir;
  const auto error = [&](const std::string& content) {
    dir.write("calib.txt", content);
    return error_of([&] { find_camera(dir.path()); });
  };
  expect_says(error("1 2 3\n"), {"calib.txt:1", "3 numbers where 9"});
  expect_says(error("199 199 120 nan 0 0 0 0 0\n"), {"calib.txt:1", "column 4"});
  expect_says(error("199 199 120 x 0 0 0 0 0\n"), {"calib.txt:1", "column 4"});
  expect_says(error("0 199 120 90 0 0 0 0 0\n"), {"calib.txt:1", "positive"});
  expect_says(error(""), {"calib.txt", "0 numbers"});
}

TEST(Rig, RotationIsMadeExactlyOrthonormal) {
  const TempDir dir;
  dir.write("imu.yaml", kImu);
  dir.write("camchain-imucam.yaml",
            "cam0:\n" + replaced(kMount, "0.0, 1.0, 0.0, 0.1", "0.0004, 1.0002, 0.0, 0.1") + kLens + kRest);
  const Mat3 R = load_rig(dir.path()).T_i_c.R();
  EXPECT_LT((R.transpose() * R - Mat3::Identity()).norm(), 1e-14);
}

TEST(Rig, ComesBackFromItsYaml) {
  std::mt19937 rng(1);
  Rig rig;
  rig.camera = {346, 260, 170.123456789012,         171,
                173, 130, Distortion::kEquidistant, {-0.03, 0.01, -0.004, 0.001, 0}};
  rig.T_i_c = {quat_exp(test::random_vec3(rng)), test::random_vec3(rng)};
  rig.time_offset_s = -1.0 / 3000;
  rig.imu = {1e-3 / 3, 2e-5, 3e-3, 4e-4, 805.5};
  const TempDir dir;
  for (const Distortion model : {Distortion::kEquidistant, Distortion::kRadTan, Distortion::kNone}) {
    rig.camera.distortion = model;
    if (model == Distortion::kNone) rig.camera.coeffs = {};
    const Rig back = load_rig(dir.path(), dir.write("rig.yaml", rig_to_yaml(rig)));
    EXPECT_EQ(back.camera.distortion, model);
    EXPECT_EQ(back.camera.coeffs, rig.camera.coeffs);
    EXPECT_EQ(back.camera.fx, rig.camera.fx);
    EXPECT_EQ(back.camera.height, 260);
    EXPECT_EQ(back.time_offset_s, rig.time_offset_s);
    EXPECT_EQ(back.imu.gyro_density, rig.imu.gyro_density);
    EXPECT_EQ(back.imu.rate_hz, rig.imu.rate_hz);
    EXPECT_LT((back.T_i_c.R() - rig.T_i_c.R()).norm(), 1e-14);
    EXPECT_LT((back.T_i_c.p - rig.T_i_c.p).norm(), 1e-14);
  }
}

TEST(Rig, OpenVins) {
  const TempDir dir;
  const std::string mount = R"(  T_imu_cam:
  - [0.0, -1.0, 0.0, 0.2]
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 0.0, 1.0, -0.3]
  - [0.0, 0.0, 0.0, 1.0]
)";
  dir.write("kalibr_imucam_chain.yaml", "%YAML:1.0\n\ncam0:\n" + mount + kLens + kRest);
  std::string imu = "%YAML:1.0\n\nimu0:\n";
  std::istringstream lines(kImu);
  for (std::string line; std::getline(lines, line);) imu += "  " + line + "\n";
  dir.write("kalibr_imu_chain.yaml", imu);
  expect_the_rig(load_rig(dir.path()));
}

const std::string kBasalt = R"({"value0": {
  "T_imu_cam": [{"px": 0.2, "py": -0.1, "pz": -0.3, "qx": 0, "qy": 0, "qz": 0.7071067811865476, "qw": 0.7071067811865476}],
  "intrinsics": [{"camera_type": "kb4", "intrinsics": {"fx": 199.5, "fy": 198.5, "cx": 132.25, "cy": 110.75,
    "k1": -0.01, "k2": 0.02, "k3": -0.003, "k4": 0.0007}}],
  "resolution": [[240, 180]],
  "accel_noise_std": [0.01, 0.01, 0.01], "gyro_noise_std": [0.002, 0.002, 0.001],
  "accel_bias_std": [0.001, 0.001, 0.001], "gyro_bias_std": 3e-5,
  "imu_update_rate": 200.0, "cam_time_offset_ns": 2500000
}})";

TEST(Rig, Basalt) {
  const TempDir dir;
  const Rig rig = load_rig(dir.path(), dir.write("b.json", kBasalt));
  EXPECT_EQ(rig.camera.distortion, Distortion::kEquidistant);
  EXPECT_EQ(rig.camera.coeffs[3], 0.0007);
  EXPECT_EQ(rig.camera.width, 240);
  EXPECT_NEAR(rig.time_offset_s, 0.0025, 1e-12);
  EXPECT_EQ(rig.imu.gyro_density, 0.002);
  EXPECT_EQ(rig.imu.gyro_walk, 3e-5);
  EXPECT_LT((rig.T_i_c * Vec3(0.1, 0.2, 0.3)).norm(), 1e-12);
  const auto error = [&](const std::string& what, const std::string& by) {
    return error_of([&] { load_rig(dir.path(), dir.write("b.json", replaced(kBasalt, what, by))); });
  };
  expect_says(error("\"kb4\"", "\"ds\""), {"b.json:3", "ds", "kb4"});
  expect_says(error("\"qw\": 0.7", "\"qw\": 1.7"), {"b.json:2", "quaternion"});
  expect_says(error("\"k2\": 0.02, ", ""), {"b.json", "k2"});
}

const std::string kInivation = R"(<?xml version="1.0"?>
<opencv_storage>
<DAVIS240C_00000042>
  <camera_matrix type_id="opencv-matrix">
    <rows>3</rows><cols>3</cols><dt>d</dt>
    <data>
      1.995e+02 0. 132.25 0. 198.5 110.75 0. 0. 1.</data></camera_matrix>
  <distortion_coefficients type_id="opencv-matrix">
    <rows>1</rows><cols>5</cols><dt>d</dt>
    <data>
      -0.36 0.15 -0.0003 -0.0007 0.</data></distortion_coefficients></DAVIS240C_00000042>
<use_fisheye_model>0</use_fisheye_model>
<image_width>240</image_width>
<image_height>180</image_height>
</opencv_storage>
)";

TEST(Rig, InivationLens) {
  const TempDir dir;
  const auto rest = dir.write("rest.yaml", "cam0:\n" + kMount + "  timeshift_cam_imu: 0.0025\n" + kImu);
  dir.write("calibration.xml", kInivation);
  expect_the_rig(load_rig(dir.path(), rest));
  const auto error = [&](const std::string& what, const std::string& by) {
    dir.write("calibration.xml", replaced(kInivation, what, by));
    return error_of([&] { load_rig(dir.path(), rest); });
  };
  expect_says(error("198.5", "x"), {"calibration.xml:6", "not a finite number"});
  expect_says(error("<image_height>180</image_height>", ""), {"calibration.xml", "image_height"});
  expect_says(error("-0.0007 0.", "-0.0007 0. 0.1"), {"distortion"});
  EXPECT_EQ(error("-0.0007 0.", "-0.0007 0. 0. 0. 0."), "");
}

TEST(Rig, ApproximateOnesGiveWayToACalibratedLens) {
  const TempDir dir;
  const std::filesystem::path config = std::filesystem::path(IDOL_CONFIG_DIR) / "rig_davis346.yaml";
  Diagnostics diagnostics;
  EXPECT_EQ(load_rig(dir.path(), config, {}, &diagnostics).camera.fx, 249);
  EXPECT_EQ(diagnostics.entries().count("approximate_rig"), 1u);
  dir.write("calibration.xml", replaced(kInivation, "1.995e+02", "3.1e+02"));
  EXPECT_EQ(load_rig(dir.path(), config).camera.fx, 310);
}

TEST(Rig, ReadyOnesByName) {
  const TempDir dir;
  ASSERT_EQ(ready_rigs().size(), 4u);
  for (const ReadyRig& ready : ready_rigs()) {
    const Rig by_name = load_rig(dir.path(), std::string(ready.name));
    const Rig by_path = load_rig(dir.path(), fmt::format("{}/rig_{}.yaml", IDOL_CONFIG_DIR, ready.name));
    EXPECT_EQ(rig_to_yaml(by_name), rig_to_yaml(by_path)) << ready.name;
  }
  EXPECT_EQ(find_camera(dir.path(), "evk4")->width, 1280);
  expect_says(error_of([&] { load_rig(dir.path(), "davis999"); }),
              {"davis999", "no such rig", "davis240c, davis346"});
}

TEST(Rig, AssumedForTheRpgDataset) {
  const TempDir dir;
  const auto of_size = [](int width, int height) { return [=] { return std::pair(width, height); }; };
  Diagnostics diagnostics;
  const std::string davis = rig_to_yaml(load_rig(dir.path(), "davis240c"));
  EXPECT_EQ(rig_to_yaml(load_rig(dir.path(), {}, {}, &diagnostics, of_size(240, 180))), davis);
  EXPECT_EQ(diagnostics.entries().count("assumed_rig"), 1u);
  expect_says(error_of([&] { load_rig(dir.path()); }), {"no calibration"});
  expect_says(error_of([&] { load_rig(dir.path(), {}, {}, nullptr, of_size(346, 260)); }),
              {"no calibration", "--rig davis346", "approximate"});
  EXPECT_EQ(error_of([&] { load_rig(dir.path(), {}, {}, nullptr, of_size(100, 100)); }).find("approximate"),
            std::string::npos);
  // A folder of the dataset has the lens, which counts; another camera's lens has nothing to do with it.
  dir.write("calib.txt", kRpg);
  const Rig rig = load_rig(dir.path(), {}, {}, &diagnostics, of_size(0, 0));
  EXPECT_EQ(rig.camera.fx, 199.5);
  EXPECT_EQ(rig.time_offset_s, 0.0024);
  dir.write("calib.txt", replaced(kRpg, "199.5 198.5", "335 335"));
  expect_says(error_of([&] { load_rig(dir.path(), {}, {}, nullptr, of_size(0, 0)); }), {"no extrinsics"});
  // What is said is never overruled.
  dir.write("camchain-imucam.yaml", "cam0:\n" + kLens + kRest);
  expect_says(error_of([&] { load_rig(dir.path(), {}, {}, nullptr, of_size(240, 180)); }), {"no extrinsics"});
}

TEST(Rig, BundledDavis240cFitsTheRealRecordings) {
  const std::filesystem::path config =
      std::filesystem::path(IDOL_DATA_DIR).parent_path() / "configs/rig_davis240c.yaml";
  const TempDir dir;
  const Rig rig = load_rig(dir.path(), config);
  EXPECT_LT((rig.T_i_c.p - Vec3(0.00674696422488, 0.0007279224709, 0.0342573613538)).norm(), 1e-9);
  EXPECT_EQ(rig.time_offset_s, 0.0024);
  const std::filesystem::path data = IDOL_SHARED_DATA_DIR;
  if (!std::filesystem::exists(data)) GTEST_SKIP() << data << " is not there";
  EXPECT_EQ(load_rig(data / "real/rpg_shapes_rotation", config).camera.width, 240);
  EXPECT_THROW(load_rig(data / "real/rpg_slider_depth", config), DataError);
  EXPECT_EQ(find_camera(data / "real/rpg_slider_depth")->width, 240);
  for (const char* name :
       {"shapes_translation", "shapes_6dof", "room_6dof", "desk_6dof", "poster_6dof", "dynamic_6dof"})
    EXPECT_LT((load_rig(data / "sim" / name).T_i_c.p - Vec3(0.00674696, 0.00072793, 0.03425736)).norm(),
              1e-8);
}

}  // namespace
}  // namespace idol
