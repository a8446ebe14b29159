#include "standard_input.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>

#include "arguments.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/io/file_writer.hpp"

namespace idol::cli {
namespace {

/// A folder of its own below the system's for temporary files, removed at the program's end.
class KeptInput {
 public:
  KeptInput() {
    std::string name = (std::filesystem::temp_directory_path() / "idol-XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr)
      throw DataError(fmt::format("{}: cannot be created: {}; set TMPDIR to a folder that can be written",
                                  name, std::strerror(errno)));
    folder_ = name;
  }
  ~KeptInput() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  KeptInput(const KeptInput&) = delete;
  KeptInput& operator=(const KeptInput&) = delete;
  [[nodiscard]] std::filesystem::path file() const { return folder_ / "standard-input"; }

 private:
  std::filesystem::path folder_;
};

void copy_standard_input(const std::filesystem::path& to) {
  constexpr std::size_t kBytes = 1 << 16;
  std::array<char, kBytes> buffer{};
  FileWriter file(to);
  while (!interrupted()) {
    pollfd wait{STDIN_FILENO, POLLIN, 0};  // is ended by a signal, as read() would not be
    if (::poll(&wait, 1, -1) < 0) continue;
    const ssize_t count = ::read(STDIN_FILENO, buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw DataError(fmt::format("standard input: cannot be read: {}", std::strerror(errno)));
    if (count == 0) break;
    file.write(buffer.data(), static_cast<std::size_t>(count));
  }
  file.close();
}

}  // namespace

std::filesystem::path input_path(const std::filesystem::path& path) {
  static std::optional<KeptInput> kept;
  if (path != "-") return path;
  if (kept) throw UsageError("'-' is given twice, but there is one standard input");
  if (::isatty(STDIN_FILENO) != 0)
    throw UsageError("'-' reads standard input, which is a terminal here; pipe a recording into it");
  install_interrupt_handler();
  kept.emplace();
  copy_standard_input(kept->file());
  if (interrupted()) throw Interrupted();
  return kept->file();
}

}  // namespace idol::cli
