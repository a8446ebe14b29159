// Frames of a camera that takes pictures beside its events: some of them, undistorted, for the report.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"
#include "idol/io/frame.hpp"

namespace idol {

struct FrameFile {
  Time t = 0;
  std::filesystem::path path;
};

/// Takes at most `most` of the frames between two stamps, evenly spread, to `dir`/STAMP.png: grey, as the
/// plain pinhole sees them. `offset_s` is added to the stamps. Anything in `dir` is removed first. Frames of
/// another size than the camera are left out. Returns how many were written. Throws DataError when the frames
/// are damaged or the disk refuses.
std::size_t write_frames(FrameSource& frames, const Camera& camera, double offset_s, Time from, Time to,
                         std::size_t most, const std::filesystem::path& dir);

/// A picture of this size as grey values, rows from the top; nullopt if it is none, or has another size.
std::optional<std::vector<std::uint8_t>> read_grey_png(const std::filesystem::path& path, int width,
                                                       int height);

/// What write_frames() left, in time order.
std::vector<FrameFile> find_frames(const std::filesystem::path& dir);

}  // namespace idol
