#include <gtest/gtest.h>

#include "idol/base/diagnostics.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kImu =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y,w_RS_S_z,a_RS_S_x [m s^-2],a_RS_S_y,a_RS_S_z\r\n"
    "1403636579758555392,-0.099134701513277898,0.14730578886832138,0.02722713633111154,8.1476917083333333,-0."
    "37592158,"
    "-2.4026292\r\n"
    "1403636579763555584,-0.1,0.14,0.02,8.0,-0.4,-2.4\r\n";
constexpr const char* kTruth =
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_x, "
    "v_y, v_z, "
    "b_w_x, b_w_y, b_w_z, b_a_x, b_a_y, b_a_z\n"
    "1403636579758555392,4.6,-1.7,0.8,0.8,0,-0.6,0,0,0,0,0,0,0,0,0,0\n"
    "1403636579763555584,4.7,-1.7,0.8,0.8,0,-0.6,0,0,0,0,0,0,0,0,0,0\n";

TEST(Asl, ImuAndTruth) {
  const TempDir dir;
  for (const char* folder : {"mav0/imu0", "mav0/state_groundtruth_estimate0"})
    fs::create_directories(dir.path() / folder);
  dir.write("mav0/imu0/data.csv", kImu);
  dir.write("mav0/state_groundtruth_estimate0/data.csv", kTruth);
  const ReadBack r = read_back(dir.path());
  EXPECT_EQ(r.error, "");
  ASSERT_EQ(r.imu.size(), 2u);
  EXPECT_EQ(r.imu[0].t, 1403636579758555392);
  EXPECT_EQ(r.imu[0].gyro.y(), 0.14730578886832138);
  EXPECT_EQ(r.imu[0].accel.z(), -2.4026292);
  const auto recording = open_recording(dir.path());
  const auto truth = recording->groundtruth();
  EXPECT_TRUE(recording->truth_of_imu());
  ASSERT_TRUE(truth);
  EXPECT_EQ((*truth)[1].t, 1403636579763555584);
  EXPECT_EQ((*truth)[1].T.p.x(), 4.7);
  EXPECT_NEAR((*truth)[1].T.q.y(), -0.6, 1e-12);

  // Events of another format beside it.
  Packet events;
  events.events.push_back({1403636579758600000, 3, 4, true});
  write(dir.path() / "events.aedat4", {events}, false);
  EXPECT_EQ(read_back(dir.path()).events.size(), 1u);
  EXPECT_EQ(read_back(dir.path()).imu.size(), 2u);
}

TEST(Asl, Damage) {
  const TempDir dir;
  fs::create_directories(dir.path() / "imu0");
  dir.write("imu0/data.csv", std::string(kImu) + "1403636579768555584,-0.1,x,0.02,8.0,-0.4,-2.4\n");
  const ReadBack r = read_back(dir.path());
  EXPECT_EQ(r.imu.size(), 2u);
  EXPECT_NE(r.error.find("data.csv:4"), std::string::npos) << r.error;
}

}  // namespace
}  // namespace idol::test
