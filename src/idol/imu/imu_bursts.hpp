// IMU samples that come several at a time with one stamp, put back to the times at which they were measured.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// An IMU measures at a steady rate, but some devices send several samples in a packet and stamp all of them
/// with its arrival (a DVXplorer by USB: 805 Hz, three or four samples every 4 ms). The samples of such a
/// burst were measured between the burst before and its own stamp. They are given times that advance by the
/// measured period and are held to the stamps slowly: jitter of the packets is smoothed, and lost packets
/// leave a gap instead of longer periods.
///
/// Without bursts, samples pass unchanged. Held back is at most the burst that may not be complete yet and,
/// at the beginning, the samples that tell whether there are bursts: 16, or 128 if some of these have one
/// stamp. The result depends on the samples alone, not on when they are pushed.
class ImuBursts {
 public:
  struct Output {
    std::vector<ImuSample> samples;  ///< stamps increase strictly
    std::vector<ImuSample> repeats;  ///< dropped: the same reading again, or the same stamp without bursts
  };

  /// Takes a sample whose stamp is none before that of the last one; appends what can be given out by now.
  void push(const ImuSample& sample, Output& out);
  /// Appends what is held back: no sample will follow soon.
  void flush(Output& out);

  /// How many samples were given times other than their stamps.
  [[nodiscard]] std::int64_t spread() const { return spread_; }
  /// States that number under the kind `imu_bursts`, in place of what was stated before; `where` begins the
  /// message.
  void report(const std::string& where, Diagnostics& diagnostics) const;

 private:
  enum class Mode { kUndecided, kRegular, kBursts };
  // From the stamp of a burst to that of the next, with the number of samples of the latter.
  struct Interval {
    double length = 0;  // [ns]
    double samples = 0;
  };

  [[nodiscard]] bool is_repeat(const ImuSample& sample) const;
  void decide(bool last, Output& out);
  void pass(const ImuSample& sample, Output& out);
  bool begin_bursts_late(const ImuSample& sample);
  void begin_bursts(std::span<const Time> stamps, double mean_distance);
  void place_first_bursts(std::span<const std::size_t> begins, Output& out);
  void add(const ImuSample& sample, Output& out);
  void close_burst(Output& out);
  void add_interval(Time stamp, std::size_t samples);
  void measure_period();
  void give(std::span<const ImuSample> burst, Output& out);

  Mode mode_ = Mode::kUndecided;
  std::vector<ImuSample> held_;  // undecided: all so far; bursts: the open burst

  // Without bursts.
  std::deque<Time> stamps_;  // the last ones, in case bursts begin
  std::optional<ImuSample> newest_;

  // With bursts.
  std::deque<Interval> intervals_;
  std::optional<Time> burst_before_;  // its stamp
  double period_ = 0;                 // [ns]
  Time given_ = 0;                    // time of the last sample given out: the clock
  double usual_late_ = 0;             // mean of the stamps by that clock [ns]
  std::int64_t spread_ = 0, bursts_ = 0;
  bool stamps_differ_ = false;  // within a burst
};

}  // namespace idol
