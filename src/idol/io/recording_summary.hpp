// What a recording holds, gathered in one pass and in bounded memory.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// Event counts over time; the bins widen as the recording goes on.
class RateHistogram {
 public:
  void add(Time t);
  [[nodiscard]] double bin_s() const { return static_cast<double>(bin_) / kNsPerS; }
  /// Counts per bin since the first stamp; the last bin may be partly filled.
  [[nodiscard]] const std::vector<std::int64_t>& counts() const { return counts_; }

 private:
  Time first_ = 0;
  Time bin_ = 10'000'000;
  std::vector<std::int64_t> counts_;
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

/// Mean and scatter of a vector, in one pass.
struct VectorStats {
  std::int64_t count = 0;
  Vec3 mean = Vec3::Zero();
  Vec3 squares = Vec3::Zero();  ///< sum of squared deviations from the mean, per axis

  void add(const Vec3& v);
  /// Root of the summed variances of the three axes.
  [[nodiscard]] double scatter() const;
};

/// Everything about a recording that a newcomer wants to know before running on it.
struct RecordingSummary {
  /// A stream's extent and its longest pause.
  struct Stream {
    std::int64_t count = 0;
    Time first = 0, last = 0;
    Time longest_pause = 0, longest_pause_at = 0;  ///< [ns]; where it begins

    void add(Time t);
    [[nodiscard]] double duration_s() const { return seconds_between(first, last); }
    [[nodiscard]] double rate_hz() const;
  };

  /// Sensor size to hold the events against; zero: unknown.
  RecordingSummary(int width, int height) : width_(width), height_(height) {}
  void add(const Packet& packet);

  Stream events;
  std::int64_t on_events = 0;
  std::int64_t outside = 0;  ///< events outside the sensor
  int largest_x = -1, largest_y = -1;
  RateHistogram rate;
  PixelActivity pixels;

  Stream imu;
  std::map<std::int64_t, std::int64_t> imu_periods_us;  ///< how often each distance of two samples occurs
  VectorStats gyro;                                     ///< [rad/s]
  VectorStats accel;                                    ///< [m/s^2]
  double accel_norm_sum = 0;

  /// Median distance of two IMU samples [s]; nothing for fewer than two.
  [[nodiscard]] std::optional<double> imu_period_s() const;
  /// How many distances of two samples are longer than ten periods.
  [[nodiscard]] std::int64_t imu_gaps() const;
  /// Pixels that fire nearly all the time while their neighbours do not, row by row.
  [[nodiscard]] std::vector<std::pair<int, int>> hot_pixels() const;

 private:
  /// Number of the span of 50 ms that a stamp lies in, from 1 on.
  [[nodiscard]] std::uint32_t span_of(Time t) const {
    constexpr Time kSpan = 50'000'000;
    return static_cast<std::uint32_t>((t - events.first) / kSpan) + 1;
  }

  int width_, height_;
};

}  // namespace idol
