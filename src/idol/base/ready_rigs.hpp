// Rigs of common sensors that come with the program, found by name: rig_NAME.yaml in a folder share/idol or
// configs near the program (or the library, where that is shared), or in /usr/local/share/idol or
// /usr/share/idol.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace idol {

/// Names of the ready rigs that are found, in alphabetical order.
std::vector<std::string> ready_rig_names();

/// The file that `rig` means: `rig` itself if there is such a file, else that of the ready rig of this name.
/// Throws DataError, listing the names there are, if it is neither.
std::filesystem::path find_rig_file(const std::filesystem::path& rig);

}  // namespace idol
