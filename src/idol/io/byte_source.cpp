#include "idol/io/byte_source.hpp"

#include <fmt/format.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

#include "idol/base/diagnostics.hpp"
#include "idol/io/raw_file.hpp"

namespace idol {
namespace {

constexpr std::string_view kGzipMagic = "\x1f\x8b";
constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";

DataError truncated(const std::string& name) {
  return DataError(
      fmt::format("{}: the compressed file is cut off before its end; copy or compress it again", name));
}
DataError damaged(const std::string& name, const char* detail) {
  return DataError(
      fmt::format("{}: the compressed file is damaged ({}); copy or compress it again", name, detail));
}

class PlainSource : public ByteSource {
 public:
  explicit PlainSource(std::unique_ptr<RawFile> file) : file_(std::move(file)) {}
  std::size_t read(char* out, std::size_t size) override {
    const std::string_view bytes = file_->peek();
    const std::size_t count = std::min(size, bytes.size());
    std::memcpy(out, bytes.data(), count);
    file_->consume(count);
    return count;
  }
  [[nodiscard]] double progress() const override { return file_->progress(); }

 private:
  std::unique_ptr<RawFile> file_;
};

class GzipSource : public ByteSource {
 public:
  explicit GzipSource(std::unique_ptr<RawFile> file) : file_(std::move(file)) {
    constexpr int kLargestWindowGzipOnly = 15 + 16;
    if (inflateInit2(&stream_, kLargestWindowGzipOnly) != Z_OK) throw std::bad_alloc();
  }
  ~GzipSource() override { inflateEnd(&stream_); }
  GzipSource(const GzipSource&) = delete;
  GzipSource& operator=(const GzipSource&) = delete;

  std::size_t read(char* out, std::size_t size) override {
    stream_.next_out = reinterpret_cast<Bytef*>(out);
    stream_.avail_out = static_cast<uInt>(size);
    while (stream_.avail_out == size) {
      const std::string_view input = file_->peek();
      if (member_ended_) {  // gzip files may be concatenated
        if (input.empty()) return 0;
        inflateReset(&stream_);
        member_ended_ = false;
      }
      stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(input.data()));
      stream_.avail_in = static_cast<uInt>(input.size());
      const int status = inflate(&stream_, Z_NO_FLUSH);
      file_->consume(input.size() - stream_.avail_in);
      if (status == Z_STREAM_END) {
        member_ended_ = true;
      } else if (stream_.avail_out == size) {
        if (input.empty()) throw truncated(file_->name());
        if (status != Z_OK && status != Z_BUF_ERROR)
          throw damaged(file_->name(), stream_.msg != nullptr ? stream_.msg : "gzip");
      }
    }
    return size - stream_.avail_out;
  }
  [[nodiscard]] double progress() const override { return file_->progress(); }

 private:
  std::unique_ptr<RawFile> file_;
  z_stream stream_{};
  bool member_ended_ = false;
};

class ZstdSource : public ByteSource {
 public:
  explicit ZstdSource(std::unique_ptr<RawFile> file) : file_(std::move(file)), stream_(ZSTD_createDStream()) {
    if (!stream_) throw std::bad_alloc();
    start_ = wanted_ = ZSTD_initDStream(stream_.get());
  }

  std::size_t read(char* out, std::size_t size) override {
    ZSTD_outBuffer output{out, size, 0};
    while (output.pos == 0) {
      const std::string_view bytes = file_->peek();
      if (bytes.empty() && !inside_frame_) return 0;
      // Block by block: a call that fails yields nothing, so it must not hold good blocks beside the bad one.
      ZSTD_inBuffer input{bytes.data(), std::min(bytes.size(), wanted_), 0};
      const std::size_t status = ZSTD_decompressStream(stream_.get(), &output, &input);
      file_->consume(input.pos);
      if (output.pos == 0) {
        if (ZSTD_isError(status)) throw damaged(file_->name(), ZSTD_getErrorName(status));
        // At the end of the input the decoder may still hold output: only when it has none is it cut off.
        if (bytes.empty() && status != 0) throw truncated(file_->name());
      }
      inside_frame_ = status != 0;
      wanted_ = inside_frame_ ? status : start_;
    }
    return output.pos;
  }
  [[nodiscard]] double progress() const override { return file_->progress(); }

 private:
  struct Free {
    void operator()(ZSTD_DStream* stream) const { ZSTD_freeDStream(stream); }
  };
  std::unique_ptr<RawFile> file_;
  std::unique_ptr<ZSTD_DStream, Free> stream_;
  std::size_t start_ = 0, wanted_ = 0;  // bytes that the decoder asks for: at the start of a frame, next
  bool inside_frame_ = false;
};

}  // namespace

std::unique_ptr<ByteSource> open_bytes(const std::filesystem::path& path) {
  auto file = std::make_unique<RawFile>(path);
  const std::string_view start = file->peek();
  if (start.starts_with(kGzipMagic)) return std::make_unique<GzipSource>(std::move(file));
  if (start.starts_with(kZstdMagic)) return std::make_unique<ZstdSource>(std::move(file));
  return std::make_unique<PlainSource>(std::move(file));
}

}  // namespace idol
