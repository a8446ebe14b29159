// Recordings as streams: packets of events and IMU samples in time order, in bounded memory.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"
#include "idol/io/recording.hpp"

namespace idol {

struct ReaderOptions {
  int width = 0;  ///< sensor size, to refuse pixels outside; 0 = unknown, nothing refused
  int height = 0;
  double from_s = 0;  ///< span to read, seconds from the recording's first stamp
  double to_s = 1e30;
  bool need_imu = true;         ///< false: events alone
  bool imu_if_present = false;  ///< with need_imu false: the IMU too, where there is one
  bool need_events = true;      ///< false: the IMU alone, where there are no events
  double imu_offset_s = 0;      ///< t_imu = t_camera + offset: which IMU samples lie beside which events
  bool imu_near_events =
      false;  ///< leave out the IMU of more than 0.1 s before the first and after the last event
  std::size_t packet_events = 16384;
  StreamChoice choice = {};  ///< where the recording has several streams of a kind
};

/// A recording being read. next() yields packets until the end, then nullopt; on damage it throws
/// DataError *after* everything before the damage was delivered.
/// A packet with events carries, or follows, the IMU samples up to the first one after its last event, as far
/// as there are any; it may also carry IMU samples alone. The IMU's tail comes after the last events. Around
/// a cut span, IMU samples of 0.1 s before and after it are delivered too.
class Reader {
 public:
  virtual ~Reader() = default;
  virtual std::optional<Packet> next() = 0;
  /// True when no IMU sample follows those given out, though events may.
  [[nodiscard]] virtual bool imu_over() const = 0;
  /// First stamp of the recording (earliest of all streams), before any span was cut.
  [[nodiscard]] virtual Time first_stamp() const = 0;
  /// Share of the input consumed so far in [0, 1], for progress bars.
  [[nodiscard]] virtual double progress() const = 0;
  [[nodiscard]] virtual const Diagnostics& diagnostics() const = 0;
};

/// Opens a recording, whatever its format (by content). Throws DataError, and UsageError for an empty span or
/// when one of several streams must be chosen.
std::unique_ptr<Reader> open_reader(const std::filesystem::path& path, const ReaderOptions& options);

/// Ground truth of the recording (pose of the camera), if any: in it, or beside it.
std::optional<Trajectory> read_groundtruth(const std::filesystem::path& sequence,
                                           const StreamChoice& choice = {});

}  // namespace idol
