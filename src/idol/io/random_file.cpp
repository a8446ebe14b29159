#include "idol/io/random_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "idol/base/diagnostics.hpp"

namespace idol {

RandomFile::RandomFile(const std::filesystem::path& path) : name_(path.string()) {
  descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0) throw DataError(fmt::format("{}: cannot be opened: {}", name_, std::strerror(errno)));
  struct stat status {};
  const bool known = ::fstat(descriptor_, &status) == 0 && S_ISREG(status.st_mode);
  if (!known || status.st_size == 0) {
    ::close(descriptor_);
    throw DataError(
        fmt::format("{}: {}", name_, known ? "the file is empty" : "is no file that can be read"));
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

RandomFile::~RandomFile() { ::close(descriptor_); }

void RandomFile::read(std::uint64_t offset, std::size_t size, std::vector<std::uint8_t>& out) const {
  if (offset > size_ || size > size_ - offset)
    throw DataError(fmt::format("{}: the file is cut off: {} bytes are to follow here, {} do", where(offset),
                                size, offset < size_ ? size_ - offset : 0));
  out.resize(size);
  for (std::size_t done = 0; done < size;) {
    const ssize_t count =
        ::pread(descriptor_, out.data() + done, size - done, static_cast<off_t>(offset + done));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0)
      throw DataError(fmt::format("{}: cannot be read: {}", where(offset + done),
                                  count < 0 ? std::strerror(errno) : "the file ended"));
    done += static_cast<std::size_t>(count);
  }
}

std::string RandomFile::where(std::uint64_t offset) const {
  return fmt::format("{}, byte {}", name_, offset);
}

DataError RandomFile::damaged(std::uint64_t offset, const char* what, const char* why) const {
  return DataError(fmt::format("{}: {} is damaged: {}; copy the file again, or read what came before",
                               where(offset), what, why));
}

}  // namespace idol
