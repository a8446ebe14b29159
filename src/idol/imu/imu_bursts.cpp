#include "idol/imu/imu_bursts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "idol/base/median.hpp"

namespace idol {
namespace {

constexpr std::size_t kFirstLook = 16;    // samples; if none of them coincide, there are no bursts
constexpr std::size_t kWindow = 128;      // samples by which bursts are recognised, and the most of one burst
constexpr std::size_t kFewest = 9;        // samples that can tell
constexpr std::size_t kIntervals = 512;   // bursts by which the period is measured
constexpr std::size_t kFirstBursts = 16;  // bursts by which the first one is placed
constexpr double kTogether = 0.1;         // of the period: a sample closer to the one before came with it
constexpr double kLongestBurst = 0.5;     // of the period, from the first stamp of a burst to its last
constexpr double kSmallestPeriod = 1000;  // [ns]: no IMU is faster than 1 MHz

// A clock that advances by the period is compared with the stamp of each burst, which is the time of its last
// sample or later, but never earlier: the clock follows early stamps quickly and late ones slowly.
constexpr double kFollowEarly = 0.5, kFollowLate = 0.05;
constexpr double kLargestCorrection = 0.5;  // of the period, for the distance of two samples
constexpr double kMostAhead = 2;            // [periods] by which the clock may be ahead of a stamp
constexpr double kLost = 1.5;  // [periods] by which a stamp is later than usual where samples were lost
constexpr std::int64_t kMeanOf = 64;  // bursts that tell what is usual

struct Spacing {
  double mean = 0;           // distance of the stamps [ns]
  std::size_t together = 0;  // stamps that (nearly) repeat the one before
};

// Of at least four stamps. Two gaps among them do not count, so that samples beside a gap do not seem to
// coincide.
Spacing find_spacing(std::span<const Time> stamps) {
  constexpr std::size_t kGaps = 2;
  std::vector<Time> distances;
  for (std::size_t i = 1; i < stamps.size(); ++i) distances.push_back(stamps[i] - stamps[i - 1]);
  const Time longest = nth_smallest(distances, distances.size() - 1 - kGaps);
  Spacing spacing;
  for (const Time d : distances)
    spacing.mean += static_cast<double>(std::min(d, longest)) / static_cast<double>(distances.size());
  for (const Time d : distances)
    if (static_cast<double>(d) <= kTogether * spacing.mean) ++spacing.together;
  return spacing;
}

// A few samples with one stamp are an accident that must not change the times of all others.
bool come_in_bursts(const Spacing& spacing, std::size_t samples) {
  constexpr std::size_t kOneOf = 8;
  return spacing.mean >= kSmallestPeriod && spacing.together * kOneOf >= samples;
}

// Whether a sample belongs to the burst whose first and last stamps are these.
bool belongs(Time first, Time last, Time t, double period) {
  return static_cast<double>(t - last) <= kTogether * period &&
         static_cast<double>(t - first) <= kLongestBurst * period;
}

// The number of the first sample of each burst.
std::vector<std::size_t> find_bursts(std::span<const Time> stamps, double period) {
  std::vector<std::size_t> begins = {0};
  for (std::size_t i = 1; i < stamps.size(); ++i)
    if (!belongs(stamps[begins.back()], stamps[i - 1], stamps[i], period)) begins.push_back(i);
  return begins;
}

}  // namespace

void ImuBursts::push(const ImuSample& sample, Output& out) {
  if (is_repeat(sample)) {
    out.repeats.push_back(sample);
    return;
  }
  switch (mode_) {
    case Mode::kUndecided:
      held_.push_back(sample);
      if (held_.size() == kFirstLook || held_.size() == kWindow) decide(false, out);
      break;
    case Mode::kRegular:
      pass(sample, out);
      break;
    case Mode::kBursts:
      add(sample, out);
      break;
  }
}

void ImuBursts::flush(Output& out) {
  if (mode_ == Mode::kUndecided && !held_.empty()) decide(true, out);
  if (mode_ == Mode::kBursts && !held_.empty()) close_burst(out);
}

// The same reading at the same time; another reading may be another sample of the burst.
bool ImuBursts::is_repeat(const ImuSample& sample) const {
  const auto same = [&](const ImuSample& other) {
    return other.t == sample.t && other.accel == sample.accel && other.gyro == sample.gyro;
  };
  for (auto it = held_.rbegin(); it != held_.rend() && it->t == sample.t; ++it)
    if (same(*it)) return true;
  return newest_ && same(*newest_);
}

void ImuBursts::decide(bool last, Output& out) {
  std::vector<Time> stamps;
  for (const ImuSample& sample : held_) stamps.push_back(sample.t);
  Spacing spacing;
  if (stamps.size() >= kFewest) spacing = find_spacing(stamps);
  if (spacing.together > 0 && stamps.size() < kWindow && !last) return;
  if (come_in_bursts(spacing, stamps.size())) {
    begin_bursts(stamps, spacing.mean);
    place_first_bursts(find_bursts(stamps, spacing.mean), out);
    return;
  }
  mode_ = Mode::kRegular;
  for (const ImuSample& sample : std::exchange(held_, {})) pass(sample, out);
}

void ImuBursts::pass(const ImuSample& sample, Output& out) {
  stamps_.push_back(sample.t);
  if (stamps_.size() > kWindow) stamps_.pop_front();
  if (begin_bursts_late(sample)) return;
  if (newest_ && sample.t <= newest_->t) {
    out.repeats.push_back(sample);
    return;
  }
  newest_ = sample;
  out.samples.push_back(sample);
}

// Where bursts begin in the middle of a stream. The samples before were given out with their own stamps.
bool ImuBursts::begin_bursts_late(const ImuSample& sample) {
  if (stamps_.size() < kWindow) return false;
  // A look at this sample alone spares most of them the look at all.
  const double mean =
      static_cast<double>(stamps_.back() - stamps_.front()) / static_cast<double>(kWindow - 1);
  const Time step = stamps_.back() - stamps_[kWindow - 2];
  if (static_cast<double>(step) > kTogether * mean) return false;
  const std::vector<Time> stamps(stamps_.begin(), stamps_.end());
  const Spacing spacing = find_spacing(stamps);
  if (!come_in_bursts(spacing, stamps.size())) return false;
  begin_bursts(stamps, spacing.mean);
  burst_before_.reset();  // the open burst has lost its first samples: it tells nothing of the period
  given_ = newest_->t;
  held_ = {sample};
  return true;
}

// The last burst is still open.
void ImuBursts::begin_bursts(std::span<const Time> stamps, double mean_distance) {
  mode_ = Mode::kBursts;
  const auto begins = find_bursts(stamps, mean_distance);
  for (std::size_t b = 0; b + 1 < begins.size(); ++b)
    add_interval(stamps[begins[b + 1] - 1], begins[b + 1] - begins[b]);
  measure_period();
}

// The first burst is placed so that no sample of the next ones would be later than its stamp.
void ImuBursts::place_first_bursts(std::span<const std::size_t> begins, Output& out) {
  const auto samples = std::exchange(held_, {});
  double first =
      static_cast<double>(samples[begins[1] - 1].t - samples.front().t);  // of the first burst's last sample
  for (std::size_t b = 1; b + 1 < begins.size() && b < kFirstBursts; ++b) {
    const auto between = static_cast<double>(begins[b + 1] - begins[1]);
    first = std::min(
        first, static_cast<double>(samples[begins[b + 1] - 1].t - samples.front().t) - between * period_);
  }
  given_ = samples.front().t + std::llround(first - static_cast<double>(begins[1]) * period_);
  for (std::size_t b = 0; b + 1 < begins.size(); ++b)
    give(std::span(samples).subspan(begins[b], begins[b + 1] - begins[b]), out);
  held_.assign(samples.begin() + static_cast<std::ptrdiff_t>(begins.back()), samples.end());
}

void ImuBursts::add(const ImuSample& sample, Output& out) {
  if (!held_.empty() && !belongs(held_.front().t, held_.back().t, sample.t, period_)) close_burst(out);
  if (held_.size() < kWindow)
    held_.push_back(sample);
  else
    out.repeats.push_back(sample);
}

void ImuBursts::close_burst(Output& out) {
  add_interval(held_.back().t, held_.size());
  measure_period();
  give(held_, out);
  held_.clear();
}

void ImuBursts::add_interval(Time stamp, std::size_t samples) {
  if (burst_before_)
    intervals_.push_back({static_cast<double>(stamp - *burst_before_), static_cast<double>(samples)});
  if (intervals_.size() > kIntervals) intervals_.pop_front();
  burst_before_ = stamp;
}

// Without the intervals in which samples were lost, which last longer than their samples.
void ImuBursts::measure_period() {
  constexpr double kLonger = 1.5;  // [samples]
  std::vector<double> periods;
  for (const Interval& interval : intervals_) periods.push_back(interval.length / interval.samples);
  const double usual = median(std::move(periods));
  Interval sum;
  for (const Interval& interval : intervals_) {
    if (interval.length > (interval.samples + kLonger) * usual) continue;
    sum.length += interval.length;
    sum.samples += interval.samples;
  }
  period_ = sum.length / sum.samples;
}

void ImuBursts::give(std::span<const ImuSample> burst, Output& out) {
  const auto count = static_cast<double>(burst.size());
  const Time stamp = burst.back().t;
  double late = static_cast<double>(stamp - given_) - count * period_;  // the stamp, by the clock
  if (const double unusual = late - usual_late_; unusual > kLost * period_) {
    // The IMU went on measuring: a whole number of periods passed.
    const double lost = std::round(unusual / period_) * period_;
    given_ += std::llround(lost);
    late -= lost;
  }
  usual_late_ += (late - usual_late_) / static_cast<double>(std::min(++bursts_, kMeanOf));
  const double correction = late * (late < 0 ? kFollowEarly : kFollowLate) / count;
  const double limit = kLargestCorrection * period_;
  const double room = static_cast<double>(stamp - given_) + kMostAhead * period_;
  const double step = std::min(period_ + std::clamp(correction, -limit, limit), room / count);
  const Time from = given_;
  for (std::size_t i = 0; i < burst.size(); ++i) {
    given_ = std::max<Time>(given_ + 1, from + std::llround(static_cast<double>(i + 1) * step));
    out.samples.push_back(burst[i]);
    out.samples.back().t = given_;
  }
  stamps_differ_ = stamps_differ_ || burst.front().t < stamp;
  spread_ += std::ssize(burst);
}

void ImuBursts::report(const std::string& where, Diagnostics& diagnostics) const {
  if (spread_ == 0) return;
  const double size = static_cast<double>(spread_) / static_cast<double>(bursts_);
  constexpr double kNearlyWhole = 0.05;
  const double smaller = std::floor(size + kNearlyWhole), larger = std::ceil(size - kNearlyWhole);
  diagnostics.replace(
      "imu_bursts",
      fmt::format("{}IMU rows came in bursts of {:.0f}{} with {} stamp: they were spread at {:.0f} Hz", where,
                  smaller, larger > smaller ? fmt::format(" to {:.0f}", larger) : "",
                  stamps_differ_ ? "nearly one" : "one", kNsPerS / period_),
      spread_);
}

}  // namespace idol
