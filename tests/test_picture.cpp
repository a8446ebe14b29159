#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/frame.hpp"
#include "idol/report/picture.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

constexpr Rgb kInk{200, 100, 50};

int count_not(const Image& image, Rgb background) {
  int count = 0;
  for (const Rgb& p : image.pixels()) count += p == background ? 0 : 1;
  return count;
}

TEST(Picture, LineCoversItsPixelsFullyAndItsBordersInPart) {
  Image image(20, 9);
  image.draw_line({3, 4}, {15, 4}, 1.0, kInk);
  for (int x = 3; x <= 15; ++x) EXPECT_EQ(image.pixel(x, 4), kInk) << x;
  EXPECT_EQ(image.pixel(9, 2), Rgb{});
  EXPECT_EQ(image.pixel(9, 6), Rgb{});
  // Half a pixel down, the ink is shared by two rows.
  Image between(20, 9);
  between.draw_line({3, 4.5}, {15, 4.5}, 1.0, kInk);
  EXPECT_EQ(between.pixel(9, 4), between.pixel(9, 5));
  EXPECT_EQ(between.pixel(9, 4).r, kInk.r / 2);
}

TEST(Picture, SteepAndReversedLinesAreTheSame) {
  Image down(12, 12), up(12, 12);
  down.draw_line({2, 1}, {5, 10}, 2.0, kInk);
  up.draw_line({5, 10}, {2, 1}, 2.0, kInk);
  EXPECT_EQ(down.pixels(), up.pixels());
  EXPECT_EQ(down.pixel(2, 1), kInk);
  EXPECT_EQ(down.pixel(5, 10), kInk);
}

TEST(Picture, LinesFarOutsideAreClippedWithoutCost) {
  Image image(16, 16);
  image.draw_line({-1e9, 8}, {1e9, 8}, 1.0, kInk);
  for (int x = 0; x < 16; ++x) EXPECT_EQ(image.pixel(x, 8), kInk) << x;
  EXPECT_EQ(count_not(image, {}), 16);
  Image missed(16, 16);
  missed.draw_line({-10, -5}, {40, -5}, 3.0, kInk);
  missed.draw_line({100, 100}, {200, 300}, 3.0, kInk);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  missed.draw_line({nan, 3}, {5, 5}, 3.0, kInk);
  missed.draw_line({3, 3}, {5, std::numeric_limits<double>::infinity()}, 3.0, kInk);
  missed.draw_disc({-8, -8}, 4, kInk);
  missed.set(-1, 3, kInk);
  missed.set(3, 16, kInk);
  missed.fill_square(15, 15, 1, kInk);
  EXPECT_EQ(count_not(missed, {}), 1);
}

TEST(Picture, ClipSegmentKeepsWhatLiesInside) {
  Vec2 a(-10, 0), b(10, 20);
  EXPECT_TRUE(clip_segment(a, b, {0, 0}, {8, 100}));
  EXPECT_TRUE(a.isApprox(Vec2(0, 10)));
  EXPECT_TRUE(b.isApprox(Vec2(8, 18)));
  Vec2 c(-1, 5), d(-1, 9);
  EXPECT_FALSE(clip_segment(c, d, {0, 0}, {8, 8}));
  Vec2 e(3, 3), f(3, 3);
  EXPECT_TRUE(clip_segment(e, f, {0, 0}, {8, 8}));
  EXPECT_EQ(e, Vec2(3, 3));
}

TEST(Picture, EventsLieOnTheirEnlargedPixels) {
  const std::vector<PictureEvent> events = {{{4, 2}, 7, true}, {{1, 1}, kNoLine, true}, {{1, 1}, 7, false}};
  const Image image = draw_event_picture(8, 6, events, {}, 3);
  ASSERT_EQ(image.width(), 24);
  ASSERT_EQ(image.height(), 18);
  const Rgb background = image.pixel(0, 0);
  for (int y = 6; y < 9; ++y)
    for (int x = 12; x < 15; ++x) EXPECT_EQ(image.pixel(x, y), line_colour(7));
  EXPECT_EQ(image.pixel(11, 6), background);
  EXPECT_EQ(image.pixel(15, 8), background);
  EXPECT_NE(image.pixel(4, 4), line_colour(7)) << "negative polarity is darker";
  EXPECT_GT(image.pixel(4, 4).r, image.pixel(4, 4).b) << "a line's event hides one of no line";
  EXPECT_EQ(count_not(image, background), 18);
}

TEST(Picture, LinesAreWhiteWithHaloAndEndsInTheirColour) {
  const std::vector<PictureLine> lines = {{{5, 10}, {35, 10}, 3}};
  const Image image = draw_event_picture(40, 20, {}, lines, 3);
  const int row = 31;  // 3 * (10 + 0.5) - 0.5
  EXPECT_EQ(image.pixel(60, row), (Rgb{255, 255, 255}));
  EXPECT_EQ(image.pixel(60, row + 2).r, image.pixel(60, row - 2).r);
  EXPECT_LT(image.pixel(60, row + 2).r, 20) << "black halo on both sides";
  EXPECT_EQ(image.pixel(16, row), line_colour(3));
  EXPECT_EQ(image.pixel(106, row), line_colour(3));
}

TEST(Picture, NothingToDrawAndNowhereToDrawAreFine) {
  const Image empty = draw_event_picture(4, 3, {}, {}, 2);
  EXPECT_EQ(count_not(empty, empty.pixel(0, 0)), 0);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<PictureEvent> outside = {{{-50, 3}, 1, true}, {{3, 1e9F}, 1, true}, {{nan, 1}, 1, true}};
  EXPECT_EQ(draw_event_picture(4, 3, outside, {}, 2).pixels(), empty.pixels());
  EXPECT_TRUE(draw_event_picture(0, 0, outside, {}, 2).pixels().empty());
}

TEST(Picture, NeighbouringIdsHaveDifferentColoursAndAllAreUsed) {
  std::set<int> used;
  for (LineId id = 0; id < 100; ++id) {
    EXPECT_NE(line_colour(id), line_colour(id + 1)) << id;
    const Rgb c = line_colour(id);
    used.insert((c.r << 16) | (c.g << 8) | c.b);
  }
  EXPECT_EQ(used.size(), 12U);
}

TEST(Picture, PngHasSignatureAndSize) {
  const test::TempDir dir;
  const auto path = dir.path() / "a.png";
  write_png(path, Image(300, 7, kInk));
  std::ifstream in(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  ASSERT_GT(bytes.size(), 33U);
  EXPECT_EQ(bytes.substr(0, 8), "\x89PNG\r\n\x1a\n");
  EXPECT_EQ(bytes.substr(12, 4), "IHDR");
  EXPECT_EQ(bytes.substr(16, 8), std::string("\0\0\1\x2c\0\0\0\7", 8));
  EXPECT_EQ(bytes.substr(24, 2), "\x8\x2") << "8 bits a channel, RGB";
  EXPECT_EQ(bytes.substr(bytes.size() - 8, 4), "IEND");
}

TEST(Picture, PngThatCannotBeWrittenIsAnError) {
  const test::TempDir dir;
  EXPECT_THROW(write_png(dir.path() / "no" / "folder" / "a.png", Image(3, 3)), DataError);
  EXPECT_THROW(write_png(dir.path() / "b.png", Image(0, 0)), DataError);
}

TEST(Picture, FrameBehindTheEvents) {
  const test::TempDir dir;
  Image photo(8, 6);
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 8; ++x)
      photo.set(x, y,
                {static_cast<std::uint8_t>(20 * x), static_cast<std::uint8_t>(20 * x),
                 static_cast<std::uint8_t>(20 * x)});
  std::filesystem::create_directory(dir.path() / "images");
  write_png(dir.path() / "images/frame_0.png", photo);
  EXPECT_EQ(open_listed_images(dir.path()), nullptr);
  dir.write("images.txt", "# t file\n1.5 images/frame_0.png\n2 images/absent.png\n2.5 images/bad.png\n");
  dir.write("images/bad.png", "no picture");
  const auto frames = open_listed_images(dir.path());
  Frame frame;
  ASSERT_TRUE(frames->next(frame));
  EXPECT_EQ(frame.t, 1'500'000'000);
  EXPECT_EQ(frame.width, 8);
  EXPECT_EQ(frame.grey[8 + 3], 60);
  EXPECT_THROW(frames->next(frame), DataError);
}

}  // namespace
}  // namespace idol
