#include "idol/io/frame.hpp"

#include <fmt/format.h>
#include <png.h>

#include <fstream>
#include <sstream>
#include <string>
#include <utility>

#include "idol/base/diagnostics.hpp"
#include "idol/io/number.hpp"

namespace idol {
namespace {

constexpr std::size_t kLargestSide = 1 << 13;

void read_png(const std::filesystem::path& path, Frame& frame) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  const auto refuse = [&] {
    const std::string why = image.message;
    png_image_free(&image);
    throw DataError(fmt::format("{}: cannot be read as a PNG picture: {}", path.string(), why));
  };
  if (png_image_begin_read_from_file(&image, path.c_str()) == 0) refuse();
  if (image.width > kLargestSide || image.height > kLargestSide) {
    png_image_free(&image);
    throw DataError(
        fmt::format("{}: {} x {} pixels are no sensor's", path.string(), image.width, image.height));
  }
  image.format = PNG_FORMAT_GRAY;
  frame.width = static_cast<int>(image.width);
  frame.height = static_cast<int>(image.height);
  frame.grey.resize(PNG_IMAGE_SIZE(image));
  if (png_image_finish_read(&image, nullptr, frame.grey.data(), 0, nullptr) == 0) refuse();
}

class ListedImages : public FrameSource {
 public:
  explicit ListedImages(std::filesystem::path list) : path_(std::move(list)), in_(path_) {}

  bool next(Frame& frame) override {
    for (std::string line; std::getline(in_, line);) {
      ++line_;
      std::istringstream words(line);
      std::string stamp, file;
      if (!(words >> stamp) || stamp[0] == '#') continue;
      const auto t = parse_stamp(stamp);
      if (!t || !(words >> file))
        throw DataError(
            fmt::format("{}:{}: a stamp and the name of a picture are expected", path_.string(), line_));
      const auto picture = path_.parent_path() / file;
      if (!std::filesystem::exists(picture)) continue;  // the list is often had without its pictures
      frame.t = *t;
      read_png(picture, frame);
      return true;
    }
    return false;
  }

 private:
  std::filesystem::path path_;
  std::ifstream in_;
  std::size_t line_ = 0;
};

}  // namespace

void fill_grey(Frame& frame, Bytes bytes, std::size_t width, std::size_t height, std::size_t stride,
               std::size_t channels, std::size_t depth) {
  const std::size_t pixel = channels * depth;
  if (width == 0 || height == 0 || width > kLargestSide || height > kLargestSide || stride < width * pixel ||
      stride > bytes.size() || bytes.size() / stride < height)
    throw BadBytes{"its picture is larger than its data, or of no sensor's size"};
  frame.width = static_cast<int>(width);
  frame.height = static_cast<int>(height);
  frame.grey.resize(width * height);
  const std::size_t colours = channels > 3 ? 3 : channels;  // a fourth is transparency
  for (std::size_t y = 0, i = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x, ++i) {
      const std::uint8_t* p = bytes.data() + y * stride + x * pixel;
      unsigned sum = 0;
      for (std::size_t c = 0; c < colours; ++c) sum += p[c * depth + depth - 1];
      frame.grey[i] = static_cast<std::uint8_t>(sum / colours);
    }
}

std::unique_ptr<FrameSource> open_listed_images(const std::filesystem::path& folder) {
  const auto list = folder / "images.txt";
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(list, ignored)) return nullptr;
  return std::make_unique<ListedImages>(list);
}

}  // namespace idol
