#include "idol/io/raw_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

constexpr std::size_t kChunkBytes = 1 << 17;

}  // namespace

void refuse_pipe(const std::filesystem::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0 || S_ISREG(status.st_mode) || S_ISDIR(status.st_mode)) return;
  throw DataError(fmt::format("{}: is a {}; a recording is read more than once: write it to a file{}",
                              path.string(), S_ISFIFO(status.st_mode) ? "pipe" : "device",
                              S_ISFIFO(status.st_mode) ? ", or give '-' for standard input" : ""));
}

RawFile::RawFile(const std::filesystem::path& path) : name_(path.string()), chunk_(kChunkBytes) {
  refuse_pipe(path);  // before it is opened, which would wait for a writer
  descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0) throw DataError(fmt::format("{}: cannot be opened: {}", name_, std::strerror(errno)));
  struct stat status {};
  if (::fstat(descriptor_, &status) == 0) size_ = static_cast<double>(status.st_size);
  try {
    if (peek().empty()) throw DataError(fmt::format("{}: the file is empty", name_));
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

RawFile::~RawFile() { ::close(descriptor_); }

std::string_view RawFile::peek() {
  if (begin_ == end_) {
    ssize_t count = -1;
    do {
      count = ::read(descriptor_, chunk_.data(), chunk_.size());
    } while (count < 0 && errno == EINTR);
    if (count < 0) throw DataError(fmt::format("{}: cannot be read: {}", name_, std::strerror(errno)));
    begin_ = 0;
    end_ = static_cast<std::size_t>(count);
    read_ += static_cast<double>(count);
  }
  return {chunk_.data() + begin_, end_ - begin_};
}

double RawFile::progress() const {
  const double consumed = read_ - static_cast<double>(end_ - begin_);
  return size_ > 0 ? std::min(1.0, consumed / size_) : 0.0;
}

}  // namespace idol
