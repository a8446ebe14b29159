#include "idol/io/text_writer.hpp"

#include <fmt/format.h>
#include <zstd.h>

#include <vector>

#include "idol/base/diagnostics.hpp"

namespace idol {

class TextWriter::Compressor {
 public:
  Compressor() { ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, kLevel); }

  // Hands the compressed bytes to `put`; with `end`, all that are left.
  template <class Put>
  void run(std::string_view text, bool end, Put&& put) {
    ZSTD_inBuffer in{text.data(), text.size(), 0};
    const auto mode = end ? ZSTD_e_end : ZSTD_e_continue;
    for (std::size_t left = 1; end ? left > 0 : in.pos < in.size;) {
      ZSTD_outBuffer out{buffer_.data(), buffer_.size(), 0};
      left = ZSTD_compressStream2(context_.get(), &out, &in, mode);
      if (ZSTD_isError(left)) throw DataError(fmt::format("zstd: {}", ZSTD_getErrorName(left)));
      put(buffer_.data(), out.pos);
    }
  }

 private:
  static constexpr int kLevel = 9;
  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  std::unique_ptr<ZSTD_CCtx, Free> context_{ZSTD_createCCtx()};
  std::vector<char> buffer_ = std::vector<char>(ZSTD_CStreamOutSize());
};

TextWriter::TextWriter(const std::filesystem::path& path) : file_(path) {
  if (path.extension() == ".zst") compressor_ = std::make_unique<Compressor>();
}

TextWriter::~TextWriter() = default;

void TextWriter::write(std::string_view text) {
  if (!compressor_) return file_.write(text.data(), text.size());
  compressor_->run(text, false, [&](const char* data, std::size_t size) { file_.write(data, size); });
}

void TextWriter::close() {
  if (compressor_)
    compressor_->run({}, true, [&](const char* data, std::size_t size) { file_.write(data, size); });
  file_.close();
}

void write_text_file(const std::filesystem::path& path, std::string_view text) {
  TextWriter writer(path);
  writer.write(text);
  writer.close();
}

}  // namespace idol
