// iniVation AEDAT 4.0 recordings (DV software): events and IMU; frames and triggers are counted.
#pragma once

#include <memory>

#include "idol/io/aedat_file.hpp"
#include "idol/io/recording.hpp"

namespace idol {

/// Stamps are microseconds of the camera's clock. Accelerations in g become m/s^2, rates in deg/s rad/s,
/// along the axes of the camera's IMU. Choices are names of streams.
class AedatRecording : public Recording {
 public:
  /// Throws DataError if the file is none, or its header is damaged.
  AedatRecording(const std::filesystem::path& path, StreamChoice choice);

  [[nodiscard]] std::string format() const override { return "AEDAT 4"; }
  [[nodiscard]] bool has_events() const override { return has("EVTS"); }
  [[nodiscard]] bool has_imu() const override { return has("IMUS"); }
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  /// Walks through the file to count.
  std::unique_ptr<FrameSource> frames() override;
  [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {file_->file().name()}; }
  std::vector<StreamInfo> streams() override;
  Resolution resolution() override;

 private:
  [[nodiscard]] bool has(const char* kind) const;
  [[nodiscard]] const AedatStream* choose(const char* kind, const std::string& name, const char* plural,
                                          const char* option) const;
  void warn_if_unfinished(Diagnostics& diagnostics) const;

  std::shared_ptr<const AedatFile> file_;
  StreamChoice choice_;
};

constexpr double kStandardGravity = 9.80665;  ///< of iniVation's "g" [m/s^2]

}  // namespace idol
