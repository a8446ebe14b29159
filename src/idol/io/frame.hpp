// Pictures that a camera took beside its events: for people to look at, no odometry uses them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/io/bytes.hpp"

namespace idol {

/// An 8-bit grey picture of raw pixels, rows from the top.
struct Frame {
  Time t = 0;  ///< on the events' clock
  int width = 0, height = 0;
  std::vector<std::uint8_t> grey;
};

/// The frames of a recording in the order of the file.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  /// False at the end. Throws DataError on damage.
  virtual bool next(Frame& frame) = 0;
};

/// Fills the picture from rows of `stride` bytes with `channels` values a pixel, each of `depth` bytes, of
/// which the highest counts; colours are averaged. Throws BadBytes if the bytes are too few, or the size is
/// no sensor's.
void fill_grey(Frame& frame, Bytes bytes, std::size_t width, std::size_t height, std::size_t stride,
               std::size_t channels, std::size_t depth = 1);

/// The pictures that images.txt in the folder lists (`t file`, the RPG layout); nullptr if there is none.
std::unique_ptr<FrameSource> open_listed_images(const std::filesystem::path& folder);

}  // namespace idol
