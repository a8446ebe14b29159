// Where the streams of an RPG-style recording lie.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace idol {

/// The recording's folder: the path itself or, for a path straight to an events file, the folder it lies in.
std::filesystem::path sequence_folder(const std::filesystem::path& path);

/// The files NAME, NAME.gz and NAME.zst that exist in the folder, in this order.
std::vector<std::filesystem::path> find_stream_files(const std::filesystem::path& folder,
                                                     const std::string& name);

}  // namespace idol
