// The events that the page shows of each window: few, packed, bounded.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "idol/report/picture.hpp"

namespace idol {

/// A window as it is shown.
struct ShownWindow {
  Time t = 0;                ///< the moment that its events lie around
  std::uint32_t own = 0;     ///< events of the whole window
  std::uint32_t around = 0;  ///< of these, near enough to `t` to make a sharp picture
  std::uint32_t shown = 0;   ///< of these, packed below: evenly picked in time order
  std::string packed;        ///< see pack_events()
};

/// Most events that are shown of one window.
constexpr std::size_t kMostShownEvents = 2000;

/// At most `most` of the events, evenly picked, without those outside the sensor. Little-endian, grouped by
/// line: u16 groups; of each u32 id (0xffffffff: no line) and u16, the highest four bits of which are the
/// line's colour (line_colour_index(); 15: no line), the others the number of events; then x of all events,
/// then y of all, u16 in eighths of a pixel from the sensor's upper left corner. The highest bit of x is the
/// polarity. `most` < 4096.
std::string pack_events(std::span<const PictureEvent> events, int width, int height, std::size_t most,
                        std::uint32_t& shown);

/// Takes every window, however many there are, and keeps what fits: once it is full every other window goes,
/// and it goes on at half the pace.
class EventLog {
 public:
  EventLog(int width, int height, std::size_t most_bytes = std::size_t{10} << 20)
      : width_(width), height_(height), most_bytes_(most_bytes) {}

  /// `around`: events near `t`, in time order; `own`: how many the window had.
  void add(Time t, std::size_t own, std::span<const PictureEvent> around);
  [[nodiscard]] const std::vector<ShownWindow>& windows() const { return windows_; }
  /// Throws DataError when the disk refuses.
  void write(const std::filesystem::path& path) const;

 private:
  void halve();

  int width_, height_;
  std::size_t most_bytes_, bytes_ = 0;
  std::size_t count_ = 0, every_ = 1;
  std::vector<ShownWindow> windows_;
};

/// Throws DataError when the file cannot be read or is not such a file.
std::vector<ShownWindow> read_event_log(const std::filesystem::path& path);

}  // namespace idol
