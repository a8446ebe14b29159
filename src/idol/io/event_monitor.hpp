// Watches an event stream for what a run survives but its user should know; in bounded memory.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// A stream's extent and its pauses.
struct StreamExtent {
  static constexpr Time kLongPause = 1'000'000'000;  ///< [ns]

  std::int64_t count = 0;
  Time first = 0, last = 0;
  Time longest_pause = 0, longest_pause_at = 0;  ///< [ns]; where it begins
  std::int64_t long_pauses = 0;                  ///< of kLongPause and more

  void add(Time t);
  [[nodiscard]] double duration_s() const { return seconds_between(first, last); }
  [[nodiscard]] double rate_hz() const;
};

/// In how many short spans each pixel fired; grows with the pixels seen.
class PixelActivity {
 public:
  /// `span` numbers the spans of equal length, from 1 on, never falling.
  void add(int x, int y, std::uint32_t span) {
    if (x >= stride_ || y >= rows_) grow(x, y);
    Pixel& pixel = pixels_[index(x, y)];
    if (pixel.last_span == span) return;
    pixel.last_span = span;
    ++pixel.spans;
  }
  [[nodiscard]] std::uint32_t spans(int x, int y) const {
    return x < stride_ && y < rows_ ? pixels_[index(x, y)].spans : 0;
  }

 private:
  struct Pixel {
    std::uint32_t spans = 0;
    std::uint32_t last_span = 0;
  };
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(stride_) + static_cast<std::size_t>(x);
  }
  void grow(int x, int y);
  int stride_ = 0, rows_ = 0;
  std::vector<Pixel> pixels_;
};

class EventMonitor {
 public:
  /// Sensor size to hold the events against; zero: unknown.
  EventMonitor(int width, int height) : width_(width), height_(height) {}

  /// Events in time order, in pieces of any size.
  void add(std::span<const Event> events);

  [[nodiscard]] const StreamExtent& extent() const { return extent_; }
  [[nodiscard]] std::int64_t on_events() const { return on_events_; }
  /// Events outside the sensor.
  [[nodiscard]] std::int64_t outside() const { return outside_; }
  /// Largest pixel seen; -1 before the first event.
  [[nodiscard]] int largest_x() const { return largest_x_; }
  [[nodiscard]] int largest_y() const { return largest_y_; }
  /// Pixels that fire nearly all the time while their neighbours do not, row by row.
  [[nodiscard]] std::vector<std::pair<int, int>> hot_pixels() const;
  /// Counts silences ("no_events") and hot pixels ("hot_pixels"); call it once, at the end of the stream.
  void report(const std::string& recording, Diagnostics& diagnostics) const;

 private:
  /// Number of the span of 50 ms that a stamp lies in, from 1 on.
  [[nodiscard]] std::uint32_t span_of(Time t) const {
    constexpr Time kSpan = 50'000'000;
    return static_cast<std::uint32_t>((t - extent_.first) / kSpan) + 1;
  }

  int width_, height_;
  StreamExtent extent_;
  std::int64_t on_events_ = 0, outside_ = 0;
  int largest_x_ = -1, largest_y_ = -1;
  PixelActivity pixels_;
};

/// How the pixels seen agree with the resolution of a calibration that holds them all.
enum class SensorFit {
  kGood,    ///< they reach its borders, or are too few to tell
  kPartly,  ///< they leave a good part of it empty: perhaps a cut-out, perhaps another sensor
  kOther,   ///< nor does the principal point fit: calibration or resolution are those of another sensor
};
SensorFit sensor_fit(const EventMonitor& monitor, const Camera& camera);
/// The two facts side by side, for messages about kPartly and kOther.
std::string describe_fit(const EventMonitor& monitor, const Camera& camera);
/// Of kOther: why, and what to do.
std::string describe_other_sensor(const std::string& recording, const EventMonitor& monitor,
                                  const Camera& camera);
/// Throws DataError for kOther; counts kPartly ("part_of_sensor").
void check_sensor_fit(const std::string& recording, const EventMonitor& monitor, const Camera& camera,
                      Diagnostics& diagnostics);

}  // namespace idol
