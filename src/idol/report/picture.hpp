// Pictures of events and projected lines, for people to judge by eye.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

struct Rgb {
  std::uint8_t r = 0, g = 0, b = 0;

  bool operator==(const Rgb&) const = default;
};

/// An 8-bit RGB image, rows from the top. Drawing outside it is clipped, pixel centres are at integers.
class Image {
 public:
  Image(int width, int height, Rgb background = {});

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] Rgb pixel(int x, int y) const { return pixels_[index(x, y)]; }
  [[nodiscard]] const std::vector<Rgb>& pixels() const { return pixels_; }

  void set(int x, int y, Rgb colour);
  /// Mixes `colour` in with weight `alpha` in [0, 1].
  void blend(int x, int y, Rgb colour, double alpha);
  void fill_square(int left, int top, int size, Rgb colour);
  /// Anti-aliased segment with round ends. Ends that are not finite draw nothing.
  void draw_line(const Vec2& a, const Vec2& b, double thickness, Rgb colour);
  void draw_disc(const Vec2& centre, double radius, Rgb colour) {
    draw_line(centre, centre, 2 * radius, colour);
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  }
  [[nodiscard]] bool inside(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }

  int width_, height_;
  std::vector<Rgb> pixels_;
};

/// Cuts the segment a-b to the rectangle [low, high]. False if nothing of it lies inside.
bool clip_segment(Vec2& a, Vec2& b, const Vec2& low, const Vec2& high);

/// An event to be shown, where undistortion has put it.
struct PictureEvent {
  Eigen::Vector2f px = Eigen::Vector2f::Zero();
  LineId id = kNoLine;
  bool polarity = false;
};

/// A mapped line projected into the picture [px of the sensor].
struct PictureLine {
  Vec2 a = Vec2::Zero();
  Vec2 b = Vec2::Zero();
  LineId id = kNoLine;
};

/// Colours of lines in every picture and view, and which one a line has; neighbouring ids differ, to
/// colour-blind eyes too.
std::span<const Rgb> line_palette();
std::size_t line_colour_index(LineId id);
Rgb line_colour(LineId id);

/// The sensor enlarged `scale` times: events in the colour of their line (grey: none; darker: negative
/// polarity), over them the lines, white with ends in their colour.
Image draw_event_picture(int width, int height, std::span<const PictureEvent> events,
                         std::span<const PictureLine> lines, int scale);

/// Throws DataError when the disk refuses, or there are no pixels.
void write_png(const std::filesystem::path& path, const Image& image);
enum class PngPixels { kGrey, kRgb };  ///< one or three bytes
/// The same of width x height pixels, rows from the top.
void write_png(const std::filesystem::path& path, int width, int height, PngPixels kind, const void* pixels);

}  // namespace idol
