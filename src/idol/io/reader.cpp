#include "idol/io/reader.hpp"

#include "idol/io/stream_reader.hpp"

namespace idol {

std::unique_ptr<Reader> open_reader(const std::filesystem::path& path, const ReaderOptions& options) {
  return std::make_unique<StreamReader>(open_recording(path, options.choice), options);
}

std::optional<Trajectory> read_groundtruth(const std::filesystem::path& sequence,
                                           const StreamChoice& choice) {
  return open_recording(sequence, choice)->groundtruth();
}

}  // namespace idol
