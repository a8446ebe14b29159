#include <fmt/format.h>

#include <algorithm>

#include "idol/io/recording_summary.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::expect_says;
using test::run_idol;
using test::TempDir;

std::string quoted(const std::filesystem::path& path) { return fmt::format("'{}'", path.string()); }

/// 4 s of events in a sensor of 240 x 180 with one hot pixel, and an IMU that turns to and fro.
void write_recording(const TempDir& dir, double imu_from_s = 0, double imu_to_s = 4,
                     double imu_step_s = 0.005) {
  std::string events;
  for (int i = 0; i < 40000; ++i) {
    const int pixel = i * 7919 % (240 * 180);
    events += i % 40 == 0 ? fmt::format("{:.6f} 100 50 1\n", 1e-4 * i)
                          : fmt::format("{:.6f} {} {} {}\n", 1e-4 * i, pixel % 240, pixel / 240, i % 2);
  }
  dir.write("events.txt", events);
  std::string imu;
  for (int i = 0; imu_from_s + i * imu_step_s < imu_to_s; ++i) {
    const double t = imu_from_s + i * imu_step_s;
    imu += fmt::format("{:.6f} 0 {} 9.81 {} 0 0\n", t, std::sin(5 * t), std::sin(7 * t));
  }
  dir.write("imu.txt", imu);
}

TEST(Info, TellsWhatAGoodRecordingHolds) {
  const TempDir dir;
  write_recording(dir);
  dir.write("groundtruth.txt", "0 0 0 0 0 0 0 1\n4 0 3 4 0 0 0 1\n");
  const auto result = run_idol("info " + quoted(dir.path()));
  EXPECT_EQ(result.status, 0) << result.err;
  expect_says(result.out, {"40000 in 4.000 s", "mean 10.0 kev/s", "up to (239, 179)",
                           "hot pixels  1: (100, 50)", "800 samples", "200.0 Hz", "0 longer than 10 periods",
                           "2 poses in 4.000 s, 5.00 m", "no whole rig"});
}

TEST(Info, WarnsWhenTheRigBelongsToAnotherImu) {
  const TempDir dir;
  write_recording(dir);
  const auto rig = std::filesystem::path(IDOL_DATA_DIR).parent_path() / "configs/rig_davis240c.yaml";
  const auto result = run_idol("info " + quoted(dir.path()) + " --rig " + quoted(rig));
  EXPECT_EQ(result.status, 0) << result.err;
  expect_says(result.out, {"IMU at 200 Hz, but 1000 Hz in the rig", "240 x 180"});
}

TEST(Info, WarnsOfWhatWillHurt) {
  const TempDir dir;
  write_recording(dir, 0.5, 3, 0.02);
  dir.write("calib.txt", "100 100 64 64 0 0 0 0 0\n");
  dir.write("camchain-imucam.yaml", "cam0:\n  resolution: [128, 128]\n");
  const auto result = run_idol("info " + quoted(dir.path()));
  EXPECT_EQ(result.status, 0) << result.err;
  expect_says(result.out, {"IMU at 50 Hz", "begins 0.500 s after", "ends 1.0", "outside the 128 x 128",
                           "will refuse", "no extrinsics"});
}

TEST(Info, ShowsWhatCameBeforeDamageAndFails) {
  const TempDir dir;
  write_recording(dir);
  std::ofstream(dir.path() / "events.txt", std::ios::app) << "5.0 1 1\n6.0 1 1 1\n";
  const auto result = run_idol("info " + quoted(dir.path()));
  EXPECT_EQ(result.status, 1);
  expect_says(result.out, {"40000 in 4.000 s"});
  expect_says(result.err, {"events.txt:40001", "3 columns"});
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1);
}

TEST(Info, NamesFormatAndStreams) {
  const TempDir dir;
  test::write(dir.path() / "r.bag", {test::some_packet()}, false, test::some_truth());
  const auto result = run_idol("info " + quoted(dir.path() / "r.bag") + " --rig " +
                               quoted(std::filesystem::path(IDOL_CONFIG_DIR) / "rig_davis346.yaml"));
  EXPECT_EQ(result.status, 0) << result.err;
  expect_says(result.out,
              {"ROS 1 bag", "/dvs/events (dvs_msgs/EventArray, 1)", "/dvs/imu (sensor_msgs/Imu, 100)",
               "20 poses", "recorded with 240 x 180", "not measured on yours"});
}

TEST(Info, ExitStatus) {
  const TempDir dir;
  EXPECT_EQ(run_idol("info " + quoted(dir.path() / "absent")).status, 1);
  EXPECT_EQ(run_idol("info").status, 2);
  write_recording(dir);
  EXPECT_EQ(run_idol("info " + quoted(dir.path()) + " --bogus").status, 2);
  EXPECT_EQ(run_idol("info " + quoted(dir.path()) + " --rig " + quoted(dir.path() / "absent.yaml")).status,
            1);
}

TEST(RecordingSummary, HistogramKeepsEveryEventWhileItsBinsWiden) {
  RateHistogram rate;
  std::int64_t n = 0;
  for (Time t = 5; t < 100'000'000'000; t += 7'000'003, ++n) rate.add(t);
  EXPECT_LE(rate.counts().size(), 1024u);
  std::int64_t sum = 0;
  for (const auto count : rate.counts()) sum += count;
  EXPECT_EQ(sum, n);
  EXPECT_NEAR(rate.bin_s(), 0.16, 1e-12);
  rate.add(9'000'000'000'000'000'000);
  EXPECT_LE(rate.counts().size(), 1024u);
}

TEST(RecordingSummary, CountsGapsAndScatter) {
  RecordingSummary summary(0, 0);
  Packet packet;
  for (int i = 0; i < 1000; ++i) {
    if (i >= 300 && i < 320) continue;
    packet.imu.push_back({i * 1'000'000, Vec3(0, i % 2, 9.81), Vec3::Zero()});
  }
  summary.add(packet);
  EXPECT_EQ(summary.imu_gaps(), 1);
  EXPECT_NEAR(*summary.imu_period_s(), 1e-3, 1e-12);
  EXPECT_EQ(summary.imu.longest_pause, 21'000'000);
  EXPECT_EQ(summary.imu.longest_pause_at, 299'000'000);
  EXPECT_NEAR(summary.accel.scatter(), 0.5, 1e-3);
  EXPECT_NEAR(summary.gyro.scatter(), 0, 1e-12);
  EXPECT_TRUE(summary.events.hot_pixels().empty());
  EXPECT_EQ(RecordingSummary(0, 0).imu_period_s(), std::nullopt);
}

/// 20 s of a camera that turns to and fro at changing rates; its clock is `offset_s` behind that of the IMU.
void write_turning(const TempDir& dir, double offset_s) {
  const auto rate = [](double t) { return 2 * std::sin(3 * t) * std::sin(0.7 * t) + std::sin(8.3 * t); };
  std::string events, imu;
  int n = 0;
  for (int i = 0; i < 4000; ++i) {
    const double t = 0.005 * i;
    imu += fmt::format("{:.6f} 0 0 9.81 0.02 {} 0\n", t + offset_s, rate(t));
    for (int k = 0; k < 2 + static_cast<int>(30 * std::abs(rate(t))); ++k, ++n)
      events += fmt::format("{:.6f} {} {} 1\n", t + 1e-5 * k, n * 7919 % 240, n % 180);
  }
  dir.write("events.txt", events);
  dir.write("imu.txt", imu);
}

TEST(Info, WarnsOfClocksApart) {
  const TempDir dir;
  write_turning(dir, 0.35);
  const std::string command = "info " + quoted(dir.path());
  expect_says(run_idol(command).out, {"0.35 s apart", "t_imu = t_camera +0.35 s"});
  write_turning(dir, -0.2);
  expect_says(run_idol(command).out, {"0.20 s apart", "t_camera -0.20 s"});
  write_turning(dir, 0.03);
  EXPECT_EQ(run_idol(command).out.find("apart"), std::string::npos);
}

TEST(Info, FindsNoClocksApartWhereTheyAreNot) {
  const std::filesystem::path data = std::filesystem::path(IDOL_SHARED_DATA_DIR) / "sim";
  for (const auto& recording : {std::filesystem::path(IDOL_DATA_DIR) / "shapes_demo", data / "desk_6dof"})
    if (std::filesystem::exists(recording)) {
      EXPECT_EQ(run_idol("info " + quoted(recording)).out.find("apart"), std::string::npos) << recording;
    }
}

TEST(RecordingSummary, FindsTheSimulatorsHotPixels) {
  const std::filesystem::path sequence =
      std::filesystem::path(IDOL_SHARED_DATA_DIR) / "sim/shapes_translation";
  if (!std::filesystem::exists(sequence)) GTEST_SKIP() << sequence << " is not there";
  const auto result = run_idol("info " + quoted(sequence));
  EXPECT_EQ(result.status, 0);
  expect_says(result.out, {"1915916 in 12.000 s", "hot pixels  8:", "(20, 170)", "(185, 91)", "(42, 119)",
                           "240 x 180", "1000.0 Hz"});
  EXPECT_EQ(result.out.find("warning"), std::string::npos) << result.out;
}

}  // namespace
}  // namespace idol
