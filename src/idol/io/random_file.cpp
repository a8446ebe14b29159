#include "idol/io/random_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "idol/base/diagnostics.hpp"
#include "idol/io/byte_source.hpp"
#include "idol/io/raw_file.hpp"

namespace idol {

class RandomFile::Descriptor {
 public:
  explicit Descriptor(int file) : file_(file) {}
  ~Descriptor() { ::close(file_); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return file_; }

 private:
  int file_;
};

namespace {

bool is_compressed(int file) {
  std::array<unsigned char, 4> start{};
  if (::pread(file, start.data(), start.size(), 0) != static_cast<ssize_t>(start.size())) return false;
  constexpr std::array<unsigned char, 4> kZstd{0x28, 0xb5, 0x2f, 0xfd};
  return start == kZstd || (start[0] == 0x1f && start[1] == 0x8b);
}

/// All that the file decompresses to, in a file without a name.
int decompress(const std::filesystem::path& path) {
  std::string name = (std::filesystem::temp_directory_path() / "idol-XXXXXX").string();
  const int file = ::mkstemp(name.data());
  if (file < 0)
    throw DataError(fmt::format("{}: cannot be created: {}; set TMPDIR", name, std::strerror(errno)));
  ::unlink(name.c_str());
  try {
    const auto bytes = open_bytes(path);
    std::vector<char> piece(1 << 20);
    while (const std::size_t count = bytes->read(piece.data(), piece.size()))
      for (std::size_t done = 0; done < count;) {
        const ssize_t written = ::write(file, piece.data() + done, count - done);
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0)
          throw DataError(fmt::format("{}: no room to decompress {}: {}; set TMPDIR to a larger disk",
                                      std::filesystem::temp_directory_path().string(), path.string(),
                                      std::strerror(errno)));
        done += static_cast<std::size_t>(written);
      }
  } catch (...) {
    ::close(file);
    throw;
  }
  return file;
}

}  // namespace

RandomFile::RandomFile(const std::filesystem::path& path) : name_(path.string()) {
  refuse_pipe(path);
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) throw DataError(fmt::format("{}: cannot be opened: {}", name_, std::strerror(errno)));
  descriptor_ = std::make_shared<Descriptor>(file);
  struct stat status {};
  const bool known = ::fstat(file, &status) == 0 && S_ISREG(status.st_mode);
  if (!known || status.st_size == 0)
    throw DataError(
        fmt::format("{}: {}", name_, known ? "the file is empty" : "is no file that can be read"));
  if (is_compressed(file)) {
    // A recording is opened several times; the last one stays at hand.
    struct Kept {
      dev_t device = 0;
      ino_t inode = 0;
      timespec changed{};
      std::shared_ptr<const Descriptor> file;
    };
    static Kept kept;
    static std::mutex mutex;
    const std::lock_guard lock(mutex);
    if (!kept.file || kept.device != status.st_dev || kept.inode != status.st_ino ||
        kept.changed.tv_sec != status.st_mtim.tv_sec || kept.changed.tv_nsec != status.st_mtim.tv_nsec)
      kept = {status.st_dev, status.st_ino, status.st_mtim, std::make_shared<Descriptor>(decompress(path))};
    descriptor_ = kept.file;
    ::fstat(descriptor_->get(), &status);
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

RandomFile::~RandomFile() = default;

void RandomFile::read(std::uint64_t offset, std::size_t size, std::vector<std::uint8_t>& out) const {
  if (offset > size_ || size > size_ - offset)
    throw DataError(fmt::format("{}: the file is cut off: {} bytes are to follow here, {} do", where(offset),
                                size, offset < size_ ? size_ - offset : 0));
  out.resize(size);
  for (std::size_t done = 0; done < size;) {
    const ssize_t count =
        ::pread(descriptor_->get(), out.data() + done, size - done, static_cast<off_t>(offset + done));
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
