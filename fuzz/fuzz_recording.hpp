// A recording of arbitrary bytes, read to its end in every way there is.
#pragma once

#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "idol/io/stream_reader.hpp"

namespace idol {

/// A file in memory, with a name: the HDF5 library follows links, so that /proc/self/fd will not do.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* data, std::size_t size) {
    const int descriptor = ::mkstemp(path_.data());
    for (std::size_t done = 0; done < size;) {
      const ssize_t count = ::write(descriptor, data + done, size - done);
      if (count <= 0) std::abort();
      done += static_cast<std::size_t>(count);
    }
    ::close(descriptor);
  }
  ~MemoryFile() { ::unlink(path_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_ = "/dev/shm/idol_fuzz_XXXXXX";
};

/// Refusals (DataError, UsageError) are fine; anything else ends the fuzzer.
template <class Format>
void read_in_every_way(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  const auto attempt = [](auto&& read) {
    try {
      read();
    } catch (const DataError&) {
    } catch (const UsageError&) {
    }
  };
  attempt([&] {
    ReaderOptions options;
    options.width = 240;
    options.height = 180;
    options.need_events = options.need_imu = false;
    options.imu_if_present = true;
    StreamReader reader(std::make_unique<Format>(file.path(), StreamChoice{}), options);
    while (reader.next()) static_cast<void>(reader.progress());
  });
  attempt([&] { static_cast<void>(Format(file.path(), StreamChoice{}).streams()); });
  attempt([&] { static_cast<void>(Format(file.path(), StreamChoice{}).resolution()); });
  attempt([&] { static_cast<void>(Format(file.path(), StreamChoice{}).groundtruth()); });
  attempt([&] {
    const auto frames = Format(file.path(), StreamChoice{}).frames();
    Frame frame;
    while (frames && frames->next(frame)) static_cast<void>(frame.grey.size());
  });
}

}  // namespace idol
