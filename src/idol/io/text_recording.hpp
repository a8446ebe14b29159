// RPG-style recordings: events.txt and imu.txt side by side, each plain or compressed.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "idol/io/recording.hpp"

namespace idol {

class TextRecording : public Recording {
 public:
  /// A recording's folder, or an events file (the IMU is then looked for beside it).
  explicit TextRecording(std::filesystem::path path);

  [[nodiscard]] std::string format() const override { return "text"; }
  [[nodiscard]] bool has_events() const override;
  [[nodiscard]] bool has_imu() const override;
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  std::optional<Trajectory> groundtruth() override;

 private:
  /// The stream's file in the folder. Throws DataError if there is none.
  [[nodiscard]] std::filesystem::path find(const std::string& name, Diagnostics& diagnostics) const;

  std::filesystem::path path_, folder_;
};

/// The IMU samples of one text file, `t ax ay az gx gy gz`. Throws DataError if it cannot be opened.
std::unique_ptr<RowSource<ImuSample>> open_imu_text(const std::filesystem::path& path);

}  // namespace idol
