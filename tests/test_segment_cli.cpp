#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

std::string labels_of(const TempDir& dir, const fs::path& recording, const std::string& extra) {
  const fs::path out = dir.path() / "labels.txt";
  const auto result =
      run_idol(fmt::format("segment '{}' --out '{}' {}", recording.string(), out.string(), extra));
  EXPECT_EQ(result.status, 0) << result.err;
  return slurp(out);
}

// The gyro's turns change which events belong to a line, not which events there are; nothing needs them.
TEST(SegmentCommand, FollowsTheGyroWhereThereIsOne) {
  const fs::path demo = fs::path(IDOL_DATA_DIR) / "shapes_demo";
  const TempDir dir;
  const std::string with = labels_of(dir, demo, ""), without = labels_of(dir, demo, "--no-imu");
  EXPECT_EQ(std::count(with.begin(), with.end(), '\n'), std::count(without.begin(), without.end(), '\n'));
  EXPECT_TRUE(with != without);
  const fs::path events_alone = dir.path() / "events_alone";
  fs::create_directories(events_alone);
  for (const char* file : {"events.txt.zst", "camchain-imucam.yaml"})
    fs::copy(demo / file, events_alone / file);
  EXPECT_TRUE(labels_of(dir, events_alone, "") == without);
}

}  // namespace
}  // namespace idol::test
