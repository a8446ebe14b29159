#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"
#include "idol/io/recording_writer.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

std::map<std::string, std::int64_t> stream_counts(const fs::path& path) {
  std::map<std::string, std::int64_t> counts;
  for (const StreamInfo& stream : open_recording(path)->streams()) counts[stream.what] += stream.count;
  return counts;
}

double mean_accel(const ReadBack& r) {
  double sum = 0;
  for (const ImuSample& s : r.imu) sum += s.accel.norm();
  return sum / static_cast<double>(r.imu.size());
}

TEST(Aedat, RealRecordings) {
  const fs::path data = fs::path(IDOL_SHARED_DATA_DIR) / "real/aedat4";
  if (!fs::exists(data)) GTEST_SKIP() << data << " is not there";
  constexpr double kG = 9.80665;
  const ReadBack davis = read_back(data / "aestream_davis346.aedat4");
  EXPECT_EQ(davis.error, "");
  EXPECT_EQ(davis.events.size(), 117667u);
  EXPECT_EQ(davis.imu.size(), 130u);
  EXPECT_NEAR(mean_accel(davis) / kG, 0.995, 0.0005);
  const auto streams = stream_counts(data / "aestream_davis346.aedat4");
  EXPECT_EQ(streams.at("frames"), 3);
  EXPECT_EQ(streams.at("triggers"), 15);
  const auto frames = open_recording(data / "aestream_davis346.aedat4")->frames();
  ASSERT_TRUE(frames);
  int count = 0;
  for (Frame frame; frames->next(frame); ++count) {
    EXPECT_EQ(frame.width, 346);
    EXPECT_EQ(frame.height, 260);
    EXPECT_GE(frame.t, davis.events.front().t - from_seconds(0.1));
    EXPECT_LE(frame.t, davis.events.back().t + from_seconds(0.1));
    // A picture, not a constant.
    const auto [least, most] = std::minmax_element(frame.grey.begin(), frame.grey.end());
    EXPECT_GT(*most - *least, 50);
  }
  EXPECT_EQ(count, 3);
  const auto size = open_recording(data / "aestream_davis346.aedat4")->resolution();
  EXPECT_EQ(size.width, 346);
  EXPECT_EQ(size.height, 260);

  const ReadBack dvx = read_back(data / "tonic_dvxplorer.aedat4");
  EXPECT_EQ(dvx.error, "");
  EXPECT_EQ(dvx.events.size(), 111954u);
  EXPECT_EQ(dvx.imu.size(), 475u);
  EXPECT_NEAR(mean_accel(dvx) / kG, 1.078, 0.0005);
  EXPECT_EQ(stream_counts(data / "tonic_dvxplorer.aedat4").count("frames"), 0u);
}

TEST(Aedat, WrittenAndReadBack) {
  const TempDir dir;
  const Packet packet = some_packet();
  for (const bool compress : {false, true}) {
    const fs::path path = dir.path() / "r.aedat4";
    write(path, {packet}, compress);
    const ReadBack r = read_back(path);
    EXPECT_EQ(r.error, "");
    EXPECT_TRUE(r.warnings.empty());
    EXPECT_EQ(r.events, packet.events);
    ASSERT_EQ(r.imu.size(), packet.imu.size());
    for (std::size_t i = 0; i < r.imu.size(); ++i) {
      EXPECT_EQ(r.imu[i].t, packet.imu[i].t);
      EXPECT_LT((r.imu[i].accel - packet.imu[i].accel).norm(), 1e-5);
      EXPECT_LT((r.imu[i].gyro - packet.imu[i].gyro).norm(), 1e-6);
    }
    EXPECT_EQ(stream_counts(path).at("events"), std::ssize(packet.events));
  }
}

TEST(Aedat, CutOffKeepsWhatCameBefore) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.aedat4";
  write(path, {some_packet(0), some_packet(1)}, false);
  const std::string whole = slurp(path);
  const auto second = static_cast<std::size_t>(0.6 * static_cast<double>(whole.size()));
  const ReadBack r = read_back(dir.write("cut.aedat4", whole.substr(0, second)));
  EXPECT_NE(r.error.find("cut.aedat4"), std::string::npos) << r.error;
  EXPECT_NE(r.error.find("byte"), std::string::npos) << r.error;
  EXPECT_EQ(r.warnings.count("unfinished_file"), 1u);
  EXPECT_EQ(r.events.size(), some_packet(0).events.size());
}

TEST(Aedat, DamageIsToldOfAndDoesNoHarm) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.aedat4";
  write(path, {some_packet(0), some_packet(1)}, true);
  expect_survives_damage(dir, slurp(path));
}

}  // namespace
}  // namespace idol::test
