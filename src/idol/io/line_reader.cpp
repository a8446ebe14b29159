#include "idol/io/line_reader.hpp"

#include <fmt/format.h>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

constexpr std::size_t kBufferBytes = 1 << 18;

}  // namespace

LineReader::LineReader(const std::filesystem::path& path)
    : name_(path.string()),
      bytes_(open_bytes(path)),
      // One byte more, so that a last line without LF can be ended like the others.
      buffer_(kBufferBytes + 1),
      begin_(buffer_.data()),
      end_(buffer_.data()) {}

std::string LineReader::where() const { return fmt::format("{}:{}", name_, line_number_); }

std::size_t LineReader::read_bytes(char* out, std::size_t size) {
  try {
    return bytes_->read(out, size);
  } catch (const DataError& e) {
    throw DataError(fmt::format("{} (read up to line {})", e.what(), line_number_));
  }
}

bool LineReader::refill_and_next(std::string_view& line) {
  std::size_t kept = static_cast<std::size_t>(end_ - begin_);
  std::memmove(buffer_.data(), begin_, kept);
  begin_ = buffer_.data();
  end_ = begin_ + kept;
  while (true) {
    if (kept == kBufferBytes) {
      throw DataError(fmt::format("{}:{}: a line of more than {} kB: this is not a text recording", name_,
                                  line_number_ + 1, kBufferBytes / 1024));
    }
    const std::size_t count = read_bytes(buffer_.data() + kept, kBufferBytes - kept);
    if (count == 0) break;
    const char* fresh = buffer_.data() + kept;
    const bool first = kept == 0 && line_number_ == 0;
    kept += count;
    end_ = buffer_.data() + kept;
    // The byte order mark that some editors put before UTF-8.
    constexpr std::string_view kMark = "\xef\xbb\xbf";
    if (first && std::string_view(fresh, count).starts_with(kMark)) {
      begin_ += kMark.size();
      fresh = begin_;
      if (const void* end = std::memchr(fresh, '\n', static_cast<std::size_t>(end_ - fresh))) {
        take(static_cast<const char*>(end), line);
        return true;
      }
      return refill_and_next(line);
    }
    if (const void* end = std::memchr(fresh, '\n', count)) {
      take(static_cast<const char*>(end), line);
      return true;
    }
  }
  if (kept == 0) return false;
  torn_ = true;
  buffer_[kept] = '\n';
  take(buffer_.data() + kept, line);
  begin_ = end_;
  return true;
}

}  // namespace idol
