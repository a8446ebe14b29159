// HDF5 recordings: the program's own layout, and those of DSEC, M3ED and TUM-VIE.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "idol/io/hdf5_file.hpp"
#include "idol/io/recording.hpp"

namespace idol {

/// Where a layout keeps what, and in which units.
struct Hdf5Layout {
  const char* name;
  std::vector<std::string> event_groups;  ///< the usual one first
  std::int64_t ns;                        ///< a unit of its stamps
  bool clock_offset = false;              ///< microseconds to be added to the events' stamps: /t_offset
  std::string imu_group = {}, accel = {}, gyro = {}, imu_t = {};
};

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
  std::vector<StreamInfo> streams() override;
  Resolution resolution() override;

 private:
  [[nodiscard]] bool imu_inside() const;
  [[nodiscard]] std::string event_group() const;

  std::filesystem::path path_;
  StreamChoice choice_;
  std::shared_ptr<const Hdf5File> file_;
  Hdf5Layout layout_;
  std::vector<std::string> groups_;  ///< of events, those that are there
  std::filesystem::path imu_path_;   ///< a file beside this one; empty: none
};

}  // namespace idol
