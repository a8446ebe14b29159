#include "idol/io/file_writer.hpp"

#include <cerrno>

namespace idol {

FileWriter::FileWriter(const std::filesystem::path& path)
    : name_(path.string()), pending_(path), file_(std::fopen(pending_.path().c_str(), "wb")) {
  if (!file_) refuse();
}

void FileWriter::write(const void* data, std::size_t size) {
  if (std::fwrite(data, 1, size, file_.get()) != size) refuse();
  place_ += size;
}

void FileWriter::seek(std::uint64_t place) {
  if (fseeko(file_.get(), static_cast<off_t>(place), SEEK_SET) != 0) refuse();
  place_ = place;
}

void FileWriter::close() {
  if (std::fflush(file_.get()) != 0) refuse();
  if (std::fclose(file_.release()) != 0) refuse();
  pending_.commit();
}

void FileWriter::refuse() const { refuse_to_write(name_, errno); }

}  // namespace idol
