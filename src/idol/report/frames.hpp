// Frames of a camera that takes pictures beside its events: some of them, undistorted, for the report.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

struct FrameFile {
  Time t = 0;
  std::filesystem::path path;
};

/// The frames of a recording that is a folder with `images.txt` (`t filename`), as the RPG dataset has them,
/// in time order; none for any other. A row that is none of a frame is left out.
std::vector<FrameFile> frames_of_recording(const std::filesystem::path& sequence);

/// Takes at most `most` of the frames between two stamps, evenly spread, to `dir`/<stamp>.png: grey, as the
/// plain pinhole sees them. `offset_s` is added to the stamps. Anything in `dir` is removed first. Frames
/// that cannot be read or have another size than the camera are left out. Returns how many were written.
/// Throws DataError when the disk refuses.
std::size_t write_frames(const std::vector<FrameFile>& frames, const Camera& camera, double offset_s,
                         Time from, Time to, std::size_t most, const std::filesystem::path& dir);

/// A picture of this size as grey values, rows from the top; nullopt if it is none, or has another size.
std::optional<std::vector<std::uint8_t>> read_grey_png(const std::filesystem::path& path, int width,
                                                       int height);

/// What write_frames() left, in time order.
std::vector<FrameFile> find_frames(const std::filesystem::path& dir);

}  // namespace idol
