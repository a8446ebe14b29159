// The streams of HDF5 recordings, by the layout of the file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/hdf5_file.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

/// Where a layout keeps what, and in which units.
struct Hdf5Layout {
  enum class Kind {
    kColumns,  ///< t, x, y and p of the events beside each other
    kTable,    ///< rows of x, y, t in seconds and p; IMU rows of accelerations and rates (MVSEC)
    kRecords   ///< records of x, y, p and t (Metavision)
  };

  const char* name;
  std::vector<std::string> event_groups;  ///< the usual one first
  std::int64_t ns;                        ///< a unit of its stamps
  Kind kind = Kind::kColumns;
  bool clock_offset = false;  ///< microseconds to be added to the events' stamps: /t_offset
  std::string imu_group = {}, accel = {}, gyro = {}, imu_t = {};
};

constexpr std::size_t kHdf5PieceRows = 1 << 16;

/// Units of a layout as nanoseconds; what is beyond the range of stamps stays so.
Time hdf5_time(std::int64_t t, std::int64_t ns);

/// Each throws DataError for data sets that are missing, of another shape, or stamped in another unit.
std::unique_ptr<RowSource<Event>> open_hdf5_events(const Hdf5File& file, const std::string& group,
                                                   const Hdf5Layout& layout, Diagnostics& diagnostics);
std::unique_ptr<RowSource<ImuSample>> open_hdf5_imu(const Hdf5File& file, const Hdf5Layout& layout,
                                                    Diagnostics& diagnostics);

}  // namespace idol
