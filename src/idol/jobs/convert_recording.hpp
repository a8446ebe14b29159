// A recording written in another format: what `idol convert` and Python's idol.convert do.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "idol/base/diagnostics.hpp"
#include "idol/io/recording.hpp"
#include "idol/io/recording_writer.hpp"

namespace idol {

struct ConvertRequest {
  std::filesystem::path in, out;
  std::optional<RecordingFormat> format;         ///< of `out`; unset: by its name
  std::filesystem::path rig_path, imu_rig_path;  ///< calibration to write into a folder of text files
  bool compress = false;
  double from_s = 0, to_s = 1e30;  ///< seconds from the recording's first stamp
  StreamChoice choice;
};

struct Conversion {
  std::int64_t events = 0, imu = 0, poses = 0;  ///< written
  std::string damage;  ///< why the reading ended early; what came before is written. Empty: it did not
  /// The reading ended early and nothing was written: `out` was there before, or there was nothing to write.
  bool kept_old = false;
  Diagnostics diagnostics;
};

/// `interrupted` (may be empty) is asked before each packet; true ends the reading. Throws DataError, and
/// UsageError when `out` is, holds or lies in anything that is read.
Conversion convert_recording(const ConvertRequest& request, const std::function<bool()>& interrupted = {});

/// The name that RecordingFormat has outside: text, bag, hdf5, aedat4. Nullopt for any other word.
std::optional<RecordingFormat> parse_recording_format(const std::string& name);

}  // namespace idol
