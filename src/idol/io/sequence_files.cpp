#include "idol/io/sequence_files.hpp"

namespace idol {

namespace fs = std::filesystem;

fs::path sequence_folder(const fs::path& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return path;
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

std::vector<fs::path> find_stream_files(const fs::path& folder, const std::string& name) {
  std::vector<fs::path> found;
  std::error_code ignored;
  for (const char* ending : {"", ".gz", ".zst"})
    if (fs::path path = folder / (name + ending); fs::exists(path, ignored)) found.push_back(std::move(path));
  return found;
}

}  // namespace idol
