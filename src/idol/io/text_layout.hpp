// How a text file writes its rows: in which order, in which unit, and what stands before them. Found by its
// beginning.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>

#include "idol/base/diagnostics.hpp"

namespace idol {

struct EventTextLayout {
  std::array<std::size_t, 4> columns{0, 1, 2, 3};  ///< where t, x, y and the polarity stand
  std::int64_t stamp_ns = 0;                       ///< a unit of the stamps; 0: decimal seconds
  std::size_t skip = 0;       ///< lines before the rows that are no comments: names, or a size
  int width = 0, height = 0;  ///< of the sensor, where the file states it

  [[nodiscard]] bool usual() const {
    return columns == std::array<std::size_t, 4>{0, 1, 2, 3} && stamp_ns == 0;
  }
};

/// Reads names of columns (`t,x,y,p`), a first row `width height`, Metavision's `%geometry` and order
/// (x,y,p,t in us). Whole-number stamps that cannot be seconds are taken for the only unit that they can be,
/// with a warning. Throws DataError where several are possible, or for names that are not understood.
EventTextLayout find_event_layout(const std::filesystem::path& path, Diagnostics& diagnostics);

/// How a text file writes IMU samples. Units are m/s^2 and rad/s in all of them.
struct ImuTextLayout {
  std::string columns;        ///< their names, parted by blanks; the first seven are read
  std::int64_t stamp_ns = 0;  ///< a unit of the stamps, which are whole numbers; 0: decimal seconds
  bool gyro_first = false;
  std::size_t skip = 0;  ///< lines before the rows that are no comments
};

/// By the names of columns, if there are any, else that of the RPG dataset. Stamps as for events.
ImuTextLayout find_imu_layout(const std::filesystem::path& path, Diagnostics& diagnostics);

ImuTextLayout rpg_imu_layout();
ImuTextLayout asl_imu_layout();
ImuTextLayout tum_vie_imu_layout();

/// The unit of stamps that are whole numbers, from their mean distance in this unit: 1 ns, 1 us, 1 ms or 1 s
/// [ns]; 0 if none or several fit. `least_s` and `most_s`: what the distance may be [s].
std::int64_t unit_of_stamps(double mean_distance, double least_s, double most_s);
/// s, ms, us or ns.
const char* unit_name(std::int64_t ns);

}  // namespace idol
