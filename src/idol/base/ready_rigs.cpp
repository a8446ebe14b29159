#include "idol/base/ready_rigs.hpp"

#include <dlfcn.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <map>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

/// The files that this code may have come to run from: a shared library, then the program.
std::vector<fs::path> own_files() {
  std::vector<fs::path> files;
  Dl_info info{};
  // Of the program itself dladdr knows only what it was called as.
  if (dladdr(reinterpret_cast<const void*>(&ready_rig_names), &info) != 0 && info.dli_fname != nullptr &&
      fs::path(info.dli_fname).is_absolute())
    files.emplace_back(info.dli_fname);
  std::error_code unknown;
  if (const fs::path program = fs::read_symlink("/proc/self/exe", unknown); !unknown)
    files.push_back(program);
  return files;
}

/// Where ready rigs may lie: the nearest folders first.
std::vector<fs::path> folders() {
  constexpr int kHighest = 4;  // <prefix>/bin/idol, <prefix>/lib/TRIPLET/libidol.so, <source>/build/PRESET/idol
  std::vector<fs::path> out;
  for (const fs::path& file : own_files()) {
    fs::path folder = file.parent_path();
    for (int up = 0; up < kHighest; ++up, folder = folder.parent_path())
      for (const char* place : {"share/idol", "configs"}) out.push_back(folder / place);
  }
  out.emplace_back("/usr/local/share/idol");
  out.emplace_back("/usr/share/idol");
  return out;
}

/// By name.
std::map<std::string, fs::path> ready_rigs() {
  const std::string prefix = "rig_";
  std::map<std::string, fs::path> out;
  for (const fs::path& folder : folders()) {
    std::error_code missing;
    for (const auto& entry : fs::directory_iterator(folder, missing)) {
      const std::string stem = entry.path().stem().string();
      if (entry.path().extension() != ".yaml" || stem.rfind(prefix, 0) != 0) continue;
      out.emplace(stem.substr(prefix.size()), entry.path());
    }
  }
  return out;
}

}  // namespace

std::vector<std::string> ready_rig_names() {
  std::vector<std::string> names;
  for (const auto& [name, file] : ready_rigs()) names.push_back(name);
  return names;
}

fs::path find_rig_file(const fs::path& rig) {
  if (fs::is_regular_file(rig)) return rig;
  const auto rigs = ready_rigs();
  if (const auto it = rigs.find(rig.string()); it != rigs.end()) return it->second;
  if (rigs.empty()) throw DataError(fmt::format("{}: no such rig file", rig.string()));
  throw DataError(fmt::format("{}: no such rig file, and none of the ready rigs: {}", rig.string(),
                              fmt::join(ready_rig_names(), ", ")));
}

}  // namespace idol
