#include "idol/io/recording_writer.hpp"

#include "idol/io/aedat_writer.hpp"
#include "idol/io/bag_writer.hpp"
#include "idol/io/hdf5_writer.hpp"
#include "idol/io/text_recording_writer.hpp"

namespace idol {

RecordingFormat format_of_name(const std::filesystem::path& path) {
  const auto ending = path.extension();
  if (ending == ".bag") return RecordingFormat::kBag;
  if (ending == ".h5" || ending == ".hdf5") return RecordingFormat::kHdf5;
  if (ending == ".aedat4") return RecordingFormat::kAedat4;
  return RecordingFormat::kText;
}

std::unique_ptr<RecordingWriter> create_recording(const std::filesystem::path& path, RecordingFormat format,
                                                  const WriterOptions& options) {
  switch (format) {
    case RecordingFormat::kText:
      break;
    case RecordingFormat::kBag:
      return std::make_unique<BagWriter>(path, options,
                                         options.compress ? BlockCodec::kLz4 : BlockCodec::kNone);
    case RecordingFormat::kHdf5:
      return std::make_unique<Hdf5Writer>(path, options);
    case RecordingFormat::kAedat4:
      return std::make_unique<AedatWriter>(path, options,
                                           options.compress ? BlockCodec::kZstd : BlockCodec::kLz4);
  }
  return std::make_unique<TextRecordingWriter>(path, options.compress);
}

}  // namespace idol
