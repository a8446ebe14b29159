#include <gtest/gtest.h>

#include <fstream>

#include "idol/report/frames.hpp"
#include "idol/report/picture.hpp"
#include "idol/report/run_folder.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::TempDir;

Camera frame_camera() { return {32, 24, 40, 40, 15.5, 11.5, Distortion::kNone, {}}; }

/// Ten frames, 0.1 s apart, of one grey each.
void write_sequence(const TempDir& dir) {
  std::filesystem::create_directories(dir.path() / "images");
  std::string list = "# t file\n";
  for (int i = 0; i < 10; ++i) {
    const std::string name = "images/frame_" + std::to_string(i) + ".png";
    const auto grey = static_cast<std::uint8_t>(20 * i);
    write_png(dir.path() / name, Image(32, 24, {grey, grey, grey}));
    list += "1." + std::to_string(i) + " " + name + "\n";
  }
  dir.write("images.txt", list);
}

TEST(Frames, AChoiceOfThemGoesToTheRun) {
  const TempDir dir;
  write_sequence(dir);
  const auto written = [&](const Camera& camera, double offset_s, Time from, Time to, std::size_t most) {
    return write_frames(*open_listed_images(dir.path()), camera, offset_s, from, to, most,
                        dir.path() / "out");
  };
  const auto out = dir.path() / "out";
  const Time half = from_seconds(0.5), second = from_seconds(1);
  EXPECT_EQ(written(frame_camera(), 0.5, second + half, 2 * second + half, 100), 10U);
  const auto found = find_frames(out);
  ASSERT_EQ(found.size(), 10U);
  EXPECT_EQ(found.front().t, second + half) << "on the IMU's clock";
  EXPECT_EQ(written(frame_camera(), 0, from_seconds(1.45), from_seconds(1.95), 2), 2U);
  EXPECT_EQ(find_frames(out).size(), 2U) << "those of before are gone";
  EXPECT_EQ(written(frame_camera(), 0, 9 * second, 10 * second, 2), 0U);
  EXPECT_TRUE(find_frames(out).empty());
  Camera other = frame_camera();
  other.width = 64;
  EXPECT_EQ(written(other, 0, 0, 9 * second, 20), 0U) << "of another sensor";
}

TEST(Frames, AreUndistortedAsEventsAre) {
  const TempDir dir;
  std::filesystem::create_directories(dir.path() / "images");
  Camera camera = frame_camera();
  camera.distortion = Distortion::kRadTan;
  camera.coeffs = {-0.4, 0, 0, 0, 0};
  Image raw(32, 24);
  raw.fill_square(3, 3, 3, {255, 255, 255});
  write_png(dir.path() / "images" / "a.png", raw);
  dir.write("images.txt", "0.0 images/a.png\n");
  ASSERT_EQ(write_frames(*open_listed_images(dir.path()), camera, 0, 0, 1, 1, dir.path() / "out"), 1U);
  const auto pixels = read_grey_png(find_frames(dir.path() / "out")[0].path, 32, 24);
  ASSERT_TRUE(pixels);
  Vec2 centre = Vec2::Zero();
  double sum = 0;
  for (int i = 0; i < 32 * 24; ++i) {
    const double light = (*pixels)[static_cast<std::size_t>(i)];
    centre += light * Vec2(i % 32, i / 32);
    sum += light;
  }
  ASSERT_GT(sum, 0);
  EXPECT_LT((centre / sum - camera.undistort({4, 4})).norm(), 0.3);
  EXPECT_GT((camera.undistort({4, 4}) - Vec2(4, 4)).norm(), 0.6) << "the lens bends enough to tell";
  EXPECT_FALSE(read_grey_png(dir.write("no.png", "no picture"), 32, 24));
}

TEST(Frames, ARecordingWithoutHasNone) {
  const TempDir dir;
  EXPECT_FALSE(open_listed_images(dir.path()));
  EXPECT_TRUE(find_frames(dir.path() / "none").empty());
}

}  // namespace
}  // namespace idol
