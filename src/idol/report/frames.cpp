#include "idol/report/frames.hpp"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/picture.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

using Grey = std::vector<std::uint8_t>;  // rows from the top

/// Where each pixel of the plain pinhole lies in the raw frame.
std::vector<Vec2> raw_positions(const Camera& camera) {
  std::vector<Vec2> out;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) out.push_back(camera.distort(camera.normalise(Vec2(x, y))));
  return out;
}

/// Between the four pixels around each position; black outside.
Grey sampled(const Grey& raw, const std::vector<Vec2>& at, int width, int height) {
  Grey out(at.size(), 0);
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double x = std::floor(at[i].x()), y = std::floor(at[i].y());
    if (!(x >= 0 && y >= 0 && x + 1 < width && y + 1 < height)) continue;
    const double u = at[i].x() - x, v = at[i].y() - y;
    const std::uint8_t* p = raw.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(x);
    out[i] = static_cast<std::uint8_t>(
        std::lround((1 - v) * ((1 - u) * p[0] + u * p[1]) + v * ((1 - u) * p[width] + u * p[width + 1])));
  }
  return out;
}

}  // namespace

std::optional<Grey> read_grey_png(const fs::path& path, int width, int height) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_file(&png, path.c_str()) == 0) return std::nullopt;
  png.format = PNG_FORMAT_GRAY;
  Grey pixels;
  const bool fits =
      png.width == static_cast<png_uint_32>(width) && png.height == static_cast<png_uint_32>(height);
  if (fits) pixels.resize(PNG_IMAGE_SIZE(png));
  const bool read = fits && png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) != 0;
  png_image_free(&png);
  return read ? std::optional(std::move(pixels)) : std::nullopt;
}

std::size_t write_frames(FrameSource& frames, const Camera& camera, double offset_s, Time from, Time to,
                         std::size_t most, const fs::path& dir) {
  remove_pictures(dir);
  const Time apart = (to - from) / static_cast<Time>(most) + 1;
  const std::vector<Vec2> at = raw_positions(camera);
  std::size_t written = 0;
  Time next = from;
  for (Frame frame; frames.next(frame);) {
    const Time t = frame.t + from_seconds(offset_s);
    if (t < next || t > to || frame.width != camera.width || frame.height != camera.height) continue;
    if (written == 0) claim_and_clear_pictures(dir);
    write_png(dir / (format_stamp(t) + ".png"), camera.width, camera.height, PngPixels::kGrey,
              sampled(frame.grey, at, camera.width, camera.height).data());
    ++written;
    next = std::max(next + apart, t - apart / 2);
  }
  return written;
}

std::vector<FrameFile> find_frames(const fs::path& dir) {
  std::vector<FrameFile> frames;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(dir, none)) {
    const auto t = parse_stamp(entry.path().stem().string());
    if (t && entry.path().extension() == ".png") frames.push_back({*t, entry.path()});
  }
  std::sort(frames.begin(), frames.end(), [](const FrameFile& a, const FrameFile& b) { return a.t < b.t; });
  return frames;
}

}  // namespace idol
