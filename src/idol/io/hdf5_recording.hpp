// HDF5 recordings: the program's own layout, and those of DSEC, M3ED, TUM-VIE, MVSEC and Metavision.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "idol/io/hdf5_file.hpp"
#include "idol/io/hdf5_sources.hpp"
#include "idol/io/recording.hpp"

namespace idol {

/// Choices are groups. DSEC keeps its IMU in a bag (lidar_imu.bag), TUM-VIE in a text file (imu_data.txt):
/// each is looked for in the file's folder and near it.
class Hdf5Recording : public Recording {
 public:
  /// Throws DataError if the file cannot be opened or has none of the layouts.
  Hdf5Recording(const std::filesystem::path& path, StreamChoice choice);

  [[nodiscard]] std::string format() const override;
  [[nodiscard]] bool has_events() const override { return !groups_.empty(); }
  [[nodiscard]] bool has_imu() const override;
  std::unique_ptr<RowSource<Event>> events(Diagnostics& diagnostics) override;
  std::unique_ptr<RowSource<ImuSample>> imu(Diagnostics& diagnostics) override;
  std::optional<Trajectory> groundtruth() override;
  [[nodiscard]] std::vector<std::filesystem::path> files() const override;
  std::vector<StreamInfo> streams() override;
  Resolution resolution() override;

 private:
  [[nodiscard]] bool imu_inside() const;
  [[nodiscard]] std::string imu_stamps() const;
  [[nodiscard]] std::string event_group() const;
  [[nodiscard]] std::filesystem::path m3ed_poses() const;

  std::filesystem::path path_;
  StreamChoice choice_;
  std::shared_ptr<const Hdf5File> file_;
  Hdf5Layout layout_;
  std::vector<std::string> groups_;  ///< of events, those that are there
  std::filesystem::path imu_path_;   ///< a file beside this one; empty: none
};

}  // namespace idol
