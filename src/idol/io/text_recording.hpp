// Recordings of text files: events.txt and imu.txt side by side, as in the RPG dataset, each plain or
// compressed, or IMU and truth as EuRoC has them (the ASL layout).
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "idol/io/recording.hpp"
#include "idol/io/rows.hpp"

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
  [[nodiscard]] bool truth_of_imu() const override;
  [[nodiscard]] std::int64_t lost_poses() const override { return lost_poses_; }
  [[nodiscard]] std::vector<std::filesystem::path> files() const override;
  Resolution resolution() override;
  std::unique_ptr<FrameSource> frames() override { return open_listed_images(folder_); }

 private:
  /// The stream's file in the folder. Throws DataError if there is none.
  [[nodiscard]] std::filesystem::path find(const std::string& name, Diagnostics& diagnostics) const;

  /// NAME/data.csv in the folder or in its mav0; empty if there is none.
  [[nodiscard]] std::filesystem::path find_asl(const char* name) const;

  std::filesystem::path path_, folder_;
  std::int64_t lost_poses_ = 0;
};

/// One text file of IMU samples alone, in any of the layouts of rows.hpp.
class ImuTextRecording : public Recording {
 public:
  explicit ImuTextRecording(std::filesystem::path path) : path_(std::move(path)) {}

  [[nodiscard]] std::string format() const override { return "text"; }
  [[nodiscard]] bool has_events() const override { return false; }
  [[nodiscard]] bool has_imu() const override { return true; }
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {path_}; }

 private:
  std::filesystem::path path_;
};

/// The IMU samples of one text file. Throws DataError if it cannot be opened.
std::unique_ptr<RowSource<ImuSample>> open_imu_text(const std::filesystem::path& path,
                                                    const ImuTextLayout& layout);

}  // namespace idol
