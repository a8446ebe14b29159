#include "idol/imu/prepared_samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"
#include "idol/base/median.hpp"

namespace idol {
namespace {

// No gyro saturates below 125 deg/s, no accelerometer below 2 g (some are a little short of it).
constexpr double kLeastGyroRange = 2.0;
constexpr double kLeastAccelRange = 15.0;

double median_period(std::span<const ImuSample> samples) {
  std::vector<Time> steps;
  for (std::size_t i = 1; i < samples.size(); ++i)
    if (samples[i].t > samples[i - 1].t) steps.push_back(samples[i].t - samples[i - 1].t);
  if (steps.empty())
    throw DataError(
        fmt::format("only {} IMU samples of different times around {:.6f} s: at least two are needed",
                    std::min<std::size_t>(samples.size(), 1),
                    samples.empty() ? 0.0 : static_cast<double>(samples.front().t) / kNsPerS));
  return static_cast<double>(median(std::move(steps))) / kNsPerS;
}

// Differences of samples that nearly coincide would drown in their noise once divided by their distance.
// Close means: beside the usual distance, and beside the distances before and after (the rate may change).
void merge_close(std::span<const ImuSample> samples, Time begin, PreparedSamples& out) {
  constexpr double kClose = 0.25;
  const auto distance = [&](std::size_t i) {  // from sample i - 1 to i
    return i == 0 || i >= samples.size() ? 0.0 : seconds_between(samples[i - 1].t, samples[i].t);
  };
  int together = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const ImuSample& sample = samples[i];
    const double t = seconds_between(begin, sample.t);
    const double beside = std::max(distance(i - 1), distance(i + 1));
    if (i > 0 && distance(i) <= kClose * std::min(out.period, beside)) {
      ++together;
      ++out.quality.merged;
      out.times.back() += (t - out.times.back()) / together;
      out.gyro.back() += (sample.gyro - out.gyro.back()) / together;
      out.accel.back() += (sample.accel - out.accel.back()) / together;
    } else {
      together = 1;
      out.times.push_back(t);
      out.gyro.push_back(sample.gyro);
      out.accel.push_back(sample.accel);
    }
  }
}

void hold_to(double first, double last, PreparedSamples& out) {
  if (out.times.back() < last) {
    out.held_last = true;
    out.times.push_back(last);
    out.gyro.push_back(Vec3(out.gyro.back()));
    out.accel.push_back(Vec3(out.accel.back()));
  }
  if (out.times.front() > first) {
    out.held_first = true;
    out.times.insert(out.times.begin(), first);
    out.gyro.insert(out.gyro.begin(), Vec3(out.gyro.front()));
    out.accel.insert(out.accel.begin(), Vec3(out.accel.front()));
  }
}

}  // namespace

PreparedSamples prepare_samples(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias,
                                const ImuNoise& noise, const PreintegrationOptions& options) {
  PreparedSamples out;
  out.period = median_period(samples);
  out.times.reserve(samples.size() + 2);
  out.gyro.reserve(samples.size() + 2);
  out.accel.reserve(samples.size() + 2);
  merge_close(samples, begin, out);
  hold_to(0, seconds_between(begin, end), out);

  const std::size_t count = out.times.size();
  const auto variance = [&](std::span<const Vec3> values, double density) {
    const double said = density / std::sqrt(out.period), seen = white_noise(values);
    if (said > 0) out.quality.noise_ratio = std::max(out.quality.noise_ratio, seen / said);
    return Vec3(Vec3::Constant(std::pow(std::max(said, seen), 2)));
  };
  out.gyro_variance.assign(count, variance(out.gyro, noise.gyro_density));
  out.accel_variance.assign(count, variance(out.accel, noise.accel_density));
  const int gyro_saturated = inflate_saturated(out.times, out.gyro, options.gyro_range, kLeastGyroRange,
                                               out.period, out.gyro_variance);
  const int accel_saturated = inflate_saturated(out.times, out.accel, options.accel_range, kLeastAccelRange,
                                                out.period, out.accel_variance);
  out.quality.saturated = gyro_saturated + accel_saturated;

  out.gap.assign(count - 1, false);
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const double length = out.times[k + 1] - out.times[k];
    out.quality.longest_gap_s = std::max(out.quality.longest_gap_s, length);
    const bool held = (out.held_first && k == 0) || (out.held_last && k + 2 == count);
    out.gap[k] = length > options.max_gap_s || (held && length > 2 * out.period);
    out.quality.gaps += out.gap[k];
  }
  for (auto& rate : out.gyro) rate -= bias.gyro;
  for (auto& force : out.accel) force -= bias.accel;
  return out;
}

namespace {

// A parabola that leaves the range with the steeper of the slopes beside samples [first, last] and comes
// back: its mean height above the range.
double mean_excess(std::span<const double> times, std::span<const Vec3> values, int axis, std::size_t first,
                   std::size_t last, double period) {
  double slope = 0;
  const auto look = [&](std::size_t i) {
    slope = std::max(slope, std::abs(values[i + 1][axis] - values[i][axis]) / (times[i + 1] - times[i]));
  };
  if (first > 0) look(first - 1);
  if (last + 1 < values.size()) look(last);
  return slope * (times[last] - times[first] + period) / 6;
}

}  // namespace

double white_noise(std::span<const Vec3> values) {
  constexpr std::size_t kLeast = 10;
  constexpr double kNormal = 0.6745;  // median of |x|, x of deviation one
  if (values.size() < kLeast) return 0;
  std::vector<double> differences;
  for (std::size_t i = 3; i < values.size(); ++i) {
    const Vec3 third = values[i] - 3 * values[i - 1] + 3 * values[i - 2] - values[i - 3];
    for (const double d : third) differences.push_back(std::abs(d));
  }
  return median(std::move(differences)) / (kNormal * std::sqrt(1 + 9 + 9 + 1));
}

int inflate_saturated(std::span<const double> times, std::span<const Vec3> values, double range, double least,
                      double period, std::span<Vec3> variance) {
  constexpr double kAtRange = 0.999;  // the two ends of a sensor's range may differ by one step
  const std::size_t repeats = range > 0 ? 1 : 3;
  std::vector<bool> concerned(values.size(), false);
  for (int axis = 0; axis < 3; ++axis) {
    double extreme = range;
    if (range <= 0)
      for (const Vec3& v : values) extreme = std::max(extreme, std::abs(v[axis]));
    if (extreme < least) continue;
    for (std::size_t first = 0; first < values.size(); ++first) {
      const double value = values[first][axis];
      if (std::abs(value) < kAtRange * extreme) continue;
      std::size_t last = first;
      while (last + 1 < values.size() && values[last + 1][axis] == value) ++last;
      const std::size_t length = last - first + 1;
      if (length >= repeats) {
        // All of them err to the same side: `length` samples count as much as length^2 that err each for
        // itself.
        const double excess = mean_excess(times, values, axis, first, last, period);
        for (std::size_t i = first; i <= last; ++i) {
          variance[i][axis] += excess * excess * static_cast<double>(length);
          concerned[i] = true;
        }
      }
      first = last;
    }
  }
  return static_cast<int>(std::count(concerned.begin(), concerned.end(), true));
}

}  // namespace idol
