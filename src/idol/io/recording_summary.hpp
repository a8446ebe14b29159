// What a recording holds, gathered in one pass and in bounded memory.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/io/clock_check.hpp"
#include "idol/io/event_monitor.hpp"
#include "idol/io/imu_check.hpp"

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
  /// Sensor size to hold the events against; zero: unknown.
  RecordingSummary(int width, int height) : events(width, height) {}
  void add(const Packet& packet);

  EventMonitor events;
  RateHistogram rate;

  StreamExtent imu;
  std::map<std::int64_t, std::int64_t> imu_periods_us;  ///< how often each distance of two samples occurs
  VectorStats gyro;                                     ///< [rad/s]
  VectorStats accel;                                    ///< [m/s^2]
  double accel_norm_sum = 0;
  ClockCheck clocks;
  ImuCheck imu_check;

  /// Median distance of two IMU samples [s]; nothing for fewer than two.
  [[nodiscard]] std::optional<double> imu_period_s() const;
  /// How many distances of two samples are longer than ten periods.
  [[nodiscard]] std::int64_t imu_gaps() const;
};

}  // namespace idol
