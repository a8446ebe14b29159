#include "idol/report/picture.hpp"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "idol/base/diagnostics.hpp"
#include "idol/io/pending_file.hpp"

namespace idol {
namespace {

constexpr Rgb kBackground{20, 22, 27};
constexpr Rgb kUnclaimed{112, 116, 124};
constexpr Rgb kBlack{0, 0, 0};
constexpr Rgb kWhite{255, 255, 255};

/// Found by maximising the smallest CIELAB distance between any two, as seen by normal, protanopic and
/// deuteranopic eyes (Machado et al. 2009), away from the ground, the grey and the white of the lines.
constexpr std::array<Rgb, 12> kPalette = {{{249, 144, 0},
                                           {13, 153, 255},
                                           {0, 164, 81},
                                           {193, 255, 0},
                                           {8, 90, 255},
                                           {255, 0, 43},
                                           {255, 130, 199},
                                           {255, 236, 123},
                                           {189, 0, 191},
                                           {0, 234, 255},
                                           {255, 149, 125},
                                           {104, 112, 6}}};

Rgb dimmed(Rgb c) {
  const auto dim = [](std::uint8_t v) { return static_cast<std::uint8_t>(v * 3 / 4); };
  return {dim(c.r), dim(c.g), dim(c.b)};
}

double distance_to_segment(const Vec2& x, const Vec2& a, const Vec2& b) {
  const Vec2 d = b - a;
  const double length2 = d.squaredNorm();
  const double s = length2 > 0 ? std::clamp((x - a).dot(d) / length2, 0.0, 1.0) : 0.0;
  return (x - a - s * d).norm();
}

}  // namespace

Image::Image(int width, int height, Rgb background)
    : width_(width),
      height_(height),
      pixels_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), background) {}

void Image::set(int x, int y, Rgb colour) {
  if (inside(x, y)) pixels_[index(x, y)] = colour;
}

void Image::blend(int x, int y, Rgb colour, double alpha) {
  if (!inside(x, y)) return;
  Rgb& p = pixels_[index(x, y)];
  const auto mix = [alpha](std::uint8_t below, std::uint8_t above) {
    return static_cast<std::uint8_t>(std::lround((1 - alpha) * below + alpha * above));
  };
  p = {mix(p.r, colour.r), mix(p.g, colour.g), mix(p.b, colour.b)};
}

void Image::fill_square(int left, int top, int size, Rgb colour) {
  for (int y = top; y < top + size; ++y)
    for (int x = left; x < left + size; ++x) set(x, y, colour);
}

void Image::draw_line(const Vec2& a_in, const Vec2& b_in, double thickness, Rgb colour) {
  if (!a_in.allFinite() || !b_in.allFinite()) return;
  const double reach = 0.5 * thickness + 0.5;
  Vec2 a = a_in, b = b_in;
  const Vec2 low = Vec2::Constant(-reach);
  const Vec2 high = Vec2(width_ - 1, height_ - 1) + Vec2::Constant(reach);
  if (!clip_segment(a, b, low, high)) return;
  const int top = std::max(0, static_cast<int>(std::floor(std::min(a.y(), b.y()) - reach)));
  const int bottom = std::min(height_ - 1, static_cast<int>(std::ceil(std::max(a.y(), b.y()) + reach)));
  for (int y = top; y <= bottom; ++y) {
    // Only the part of the segment within reach of this row can touch it.
    Vec2 c = a, d = b;
    if (!clip_segment(c, d, Vec2(low.x(), y - reach), Vec2(high.x(), y + reach))) continue;
    const int left = std::max(0, static_cast<int>(std::floor(std::min(c.x(), d.x()) - reach)));
    const int right = std::min(width_ - 1, static_cast<int>(std::ceil(std::max(c.x(), d.x()) + reach)));
    for (int x = left; x <= right; ++x) {
      const double cover = reach - distance_to_segment(Vec2(x, y), a, b);
      if (cover > 0) blend(x, y, colour, std::min(cover, 1.0));
    }
  }
}

bool clip_segment(Vec2& a, Vec2& b, const Vec2& low, const Vec2& high) {
  // Liang and Barsky: the share [from, to] of the segment inside all four half planes.
  const Vec2 d = b - a;
  double from = 0, to = 1;
  for (int i = 0; i < 2; ++i) {
    if (d[i] == 0) {
      if (a[i] < low[i] || a[i] > high[i]) return false;
      continue;
    }
    const double enter = ((d[i] > 0 ? low[i] : high[i]) - a[i]) / d[i];
    const double leave = ((d[i] > 0 ? high[i] : low[i]) - a[i]) / d[i];
    from = std::max(from, enter);
    to = std::min(to, leave);
  }
  if (from > to) return false;
  b = a + to * d;
  a += from * d;
  return true;
}

std::span<const Rgb> line_palette() { return kPalette; }

std::size_t line_colour_index(LineId id) {
  // Fibonacci hashing: consecutive ids land far apart.
  const std::uint64_t hash = static_cast<std::uint64_t>(id) * 0x9E3779B97F4A7C15ULL;
  return ((hash >> 32) * kPalette.size()) >> 32;
}

Rgb line_colour(LineId id) { return kPalette[line_colour_index(id)]; }

Image draw_event_picture(int width, int height, std::span<const PictureEvent> events,
                         std::span<const PictureLine> lines, int scale) {
  Image image(width * scale, height * scale, kBackground);
  const auto draw_events = [&](bool claimed) {
    for (const PictureEvent& e : events) {
      if ((e.id != kNoLine) != claimed || !e.px.allFinite()) continue;
      if (e.px.x() < -1 || e.px.y() < -1 || e.px.x() > static_cast<float>(width) ||
          e.px.y() > static_cast<float>(height))
        continue;
      const Rgb colour = claimed ? line_colour(e.id) : kUnclaimed;
      const auto s = static_cast<float>(scale);
      image.fill_square(static_cast<int>(std::lround(s * e.px.x())),
                        static_cast<int>(std::lround(s * e.px.y())), scale,
                        e.polarity ? colour : dimmed(colour));
    }
  };
  draw_events(false);
  draw_events(true);
  const auto to_image = [scale](const Vec2& px) -> Vec2 {
    return scale * (px + Vec2::Constant(0.5)) - Vec2::Constant(0.5);
  };
  for (const auto& [thickness, colour] : {std::pair{4.0, kBlack}, std::pair{1.6, kWhite}})
    for (const PictureLine& line : lines)
      image.draw_line(to_image(line.a), to_image(line.b), thickness, colour);
  for (const PictureLine& line : lines) {
    for (const Vec2& end : {to_image(line.a), to_image(line.b)}) {
      image.draw_disc(end, 4.6, kBlack);
      image.draw_disc(end, 3.8, kWhite);
      image.draw_disc(end, 2.6, line_colour(line.id));
    }
  }
  return image;
}

void write_png(const std::filesystem::path& path, const Image& image) {
  static_assert(sizeof(Rgb) == 3 && std::is_trivially_copyable_v<Rgb>);
  write_png(path, image.width(), image.height(), PngPixels::kRgb, image.pixels().data());
}

void write_png(const std::filesystem::path& path, int width, int height, PngPixels kind, const void* pixels) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width);
  png.height = static_cast<png_uint_32>(height);
  png.format = kind == PngPixels::kRgb ? PNG_FORMAT_RGB : PNG_FORMAT_GRAY;
  // Packing as well as zlib can took a fifth of a run's time, for files a little smaller.
  png.flags = PNG_IMAGE_FLAG_FAST;
  if (width <= 0 || height <= 0)
    throw DataError(fmt::format("{}: an image without pixels cannot be written", path.string()));
  PendingFile file(path);
  if (png_image_write_to_file(&png, file.path().c_str(), 0, pixels, 0, nullptr) == 0)
    throw DataError(fmt::format("{}: cannot be written: {}; is the disk full?", path.string(), png.message));
  file.commit();
}

}  // namespace idol
