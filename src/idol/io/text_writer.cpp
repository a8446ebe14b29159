#include "idol/io/text_writer.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>

#include "idol/base/diagnostics.hpp"

namespace idol {

TextWriter::TextWriter(const std::filesystem::path& path)
    : name_(path.string()), file_(std::fopen(path.c_str(), "wb")) {
  if (!file_) refuse();
}

void TextWriter::write(std::string_view text) {
  if (std::fwrite(text.data(), 1, text.size(), file_.get()) != text.size()) refuse();
}

void TextWriter::close() {
  if (std::fflush(file_.get()) != 0) refuse();
  if (std::fclose(file_.release()) != 0) refuse();
}

void TextWriter::refuse() const {
  throw DataError(fmt::format("{}: cannot be written: {}", name_, std::strerror(errno)));
}

void write_text_file(const std::filesystem::path& path, std::string_view text) {
  TextWriter writer(path);
  writer.write(text);
  writer.close();
}

}  // namespace idol
