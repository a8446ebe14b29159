// The samples of a window made fit for integration, with the noise of each.
#pragma once

#include <span>
#include <vector>

#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/imu/preintegration_options.hpp"

namespace idol {

/// What was odd in the samples of a window.
struct SampleQuality {
  int merged = 0;            ///< samples whose stamp (nearly) repeats that before them: averaged with it
  int gaps = 0;              ///< spans without data longer than max_gap_s
  double longest_gap_s = 0;  ///< of all spans between samples
  int saturated = 0;         ///< samples with a reading at the sensor's range
  double noise_ratio =
      0;  ///< standard deviation of the readings' white noise by what the rig says, the larger of both
};

/// Samples at strictly increasing times with the biases taken off. Where the data end inside the window, the
/// last reading is held up to the window's end (and so at its begin).
struct PreparedSamples {
  std::vector<double> times;                        ///< [s] since the window's begin
  std::vector<Vec3> gyro;                           ///< [rad/s]
  std::vector<Vec3> accel;                          ///< [m/s^2]
  std::vector<Vec3> gyro_variance, accel_variance;  ///< of each sample's noise, an axis
  std::vector<bool> gap;                            ///< of each interval: its signal is a guess
  double period = 0;                                ///< median distance [s]
  bool held_first = false, held_last = false;       ///< the first, the last sample is such a held reading
  SampleQuality quality;
};

/// `samples` in time order, at least two with different stamps (DataError). Where the readings are noisier
/// than the rig says, by white_noise(), that noise is taken.
PreparedSamples prepare_samples(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias,
                                const ImuNoise& noise, const PreintegrationOptions& options);

/// Standard deviation of the white noise of evenly spaced readings, an axis: by the median of their third
/// differences, in which motion hardly shows. Noise that a sensor has smoothed counts for less than it is. 0
/// for fewer than 10.
double white_noise(std::span<const Vec3> values);

/// Finds readings at the sensor's range (`range`, or for 0 the extreme of the values, above `least`, if it
/// repeats in three samples at least) and adds the variance of what was cut off to theirs: the excess is
/// taken for an arc that goes on with the slopes beside it. Returns how many samples are concerned.
int inflate_saturated(std::span<const double> times, std::span<const Vec3> values, double range, double least,
                      double period, std::span<Vec3> variance);

}  // namespace idol
