#include "idol/io/recording_judgement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace idol {
namespace {

constexpr double kTolerance =
    0.1;  // [s]: of where streams begin and end, and what comparing them is good for
constexpr double kOtherUnit = 100;          // factor of two durations that no recording has by one unit
constexpr std::int64_t kFewOutside = 1000;  // one in so many pixels may lie outside

/// How much longer the IMU lasts than the events; 0: not known.
double duration_ratio(const RecordingSummary& s) {
  const double events = s.events.extent().duration_s(), imu = s.imu.duration_s();
  constexpr std::int64_t kEnough = 100;
  if (s.events.extent().count < kEnough || s.imu.count < kEnough || events <= 0 || imu <= 0) return 0;
  return imu / events;
}

void judge_rate(const RecordingSummary& s, const KnownRig& known, Diagnostics& d) {
  const double rate = 1 / s.imu_period_s().value_or(1e9);
  if (rate < 1) {
    d.warn("imu_rate", fmt::format("IMU samples are {:.3g} s apart: are their stamps in seconds?", 1 / rate));
    return;
  }
  if (rate < 100) d.warn("imu_slow", fmt::format("IMU at {:.0f} Hz: fast motion is lost below 100 Hz", rate));
  if (known.rig != nullptr && std::abs(known.rig->imu.rate_hz / rate - 1) > 0.2)
    d.warn("imu_rate",
           fmt::format("IMU at {:.0f} Hz, but {:.0f} Hz in the rig: is it that of another sensor, or are its "
                       "stamps by another clock?",
                       rate, known.rig->imu.rate_hz));
}

void judge_imu(const RecordingSummary& s, Time origin, bool whole, Diagnostics& d) {
  if (const auto gaps = s.imu_gaps(); gaps > 0)
    d.warn("imu_gap",
           fmt::format("IMU has {} gaps, the longest of {:.3f} s: the estimate drifts or restarts there",
                       gaps, static_cast<double>(s.imu.longest_pause) / kNsPerS));
  if (const double late = seconds_between(s.events.extent().first, s.imu.first); late > kTolerance)
    d.warn("events_before_imu",
           fmt::format("IMU begins {:.3f} s after the events: those before it are of no use", late));
  if (const double early = seconds_between(s.imu.last, s.events.extent().last); whole && early > kTolerance)
    d.warn("imu_ends_early",
           fmt::format("IMU ends {:.3f} s before the events: those after it are of no use", early));
  const double gravity = s.accel_norm_sum / static_cast<double>(s.imu.count);
  if (gravity < 7 || gravity > 13)
    d.warn("imu_gravity", fmt::format("mean |a| is {:.3f}, gravity 9.81: m/s^2 are expected{}", gravity,
                                      gravity > 0.7 && gravity < 1.3 ? ", this looks like g" : ""));
  if (s.gyro.scatter() > 20)
    d.warn("gyro_unit", fmt::format("rates scatter by {:.0f}: rad/s are expected, this looks like deg/s",
                                    s.gyro.scatter()));
  if (s.gyro.scatter() < 0.05 && s.accel.scatter() < 0.3)
    d.warn("imu_still", "IMU hardly moves: scale and biases cannot be told without excitation");
  s.imu_check.report(origin, d);
}

void judge_clocks(const RecordingSummary& s, const KnownRig& known, bool whole, Diagnostics& d) {
  const double expected = known.rig != nullptr ? known.rig->time_offset_s : 0;
  const auto offset = s.clocks.offset();
  if (offset && offset->certain() && std::abs(offset->seconds - expected) > kTolerance) {
    d.warn("clocks_apart", fmt::format("events and IMU seem to be {:.2f} s apart: their rates agree best "
                                       "with t_imu = t_camera {:+.2f} s; "
                                       "are their clocks synchronised?",
                                       std::abs(offset->seconds - expected), offset->seconds));
    return;
  }
  const double ratio = duration_ratio(s);
  if (!whole || ratio <= 0) return;
  const double begin = seconds_between(s.events.extent().first, s.imu.first),
               end = seconds_between(s.events.extent().last, s.imu.last);
  constexpr double kSame = 0.01;  // of the duration
  const double duration = s.events.extent().duration_s();
  if (std::abs(begin - expected) > kTolerance && std::abs(end - begin) < kSame * duration + 0.02) {
    d.warn("clocks_apart", fmt::format("the IMU begins {:.3f} s {} the events and lasts as long: does each "
                                       "stream count from its own first "
                                       "sample?",
                                       std::abs(begin), begin > 0 ? "after" : "before"));
    return;
  }
  // Of another cause than a recorder that ran longer, a ratio is a round one.
  for (const double factor : {2.0, 4.0, 10.0, 100.0, 1e3, 1e6})
    for (const double wanted : {factor, 1 / factor})
      if (std::abs(ratio / wanted - 1) < 0.03)
        d.warn("clock_speed", fmt::format("the IMU lasts {:.3f} s and the events {:.3f} s, {:g} to 1: is one "
                                          "of them stamped in another "
                                          "unit, or by a clock of another speed?",
                                          s.imu.duration_s(), duration, wanted > 1 ? wanted : 1 / factor));
}

void judge_events(const RecordingSummary& s, const KnownRig& known, Diagnostics& d) {
  const StreamExtent& events = s.events.extent();
  if (events.first == events.last && events.count > 1)
    d.warn("equal_stamps",
           fmt::format("all {} events have the stamp {:.9g} s: were they printed with too few digits?",
                       events.count, static_cast<double>(events.first) / kNsPerS));
  const Camera* camera = known.camera;
  if (camera == nullptr || camera->width == 0) return;
  if (s.events.outside() > 0)
    d.warn(
        "outside_pixel",
        fmt::format("{} events ({:.3f} %) lie outside the {} x {} of the calibration{}", s.events.outside(),
                    100.0 * static_cast<double>(s.events.outside()) / static_cast<double>(events.count),
                    camera->width, camera->height,
                    s.events.outside() * kFewOutside > events.count
                        ? ": wrong resolution or rig, a run will refuse"
                        : ""));
  const SensorFit fit = sensor_fit(s.events, *camera);
  if (fit != SensorFit::kGood)
    d.warn("part_of_sensor",
           fmt::format(
               "{}: another sensor, or a cut-out{}", describe_fit(s.events, *camera),
               fit == SensorFit::kOther ? ", and the principal point does not fit: a run will refuse" : ""));
}

/// Empty where both streams may be stamped in one unit.
std::string other_units(const std::string& recording, const RecordingSummary& s) {
  const double ratio = duration_ratio(s);
  if (ratio == 0 || (ratio < kOtherUnit && ratio > 1 / kOtherUnit)) return {};
  return fmt::format(
      "{}: the events last {:.3g} s and the IMU {:.3g} s: one of them is stamped in another unit; write both "
      "in those that docs/formats.md states",
      recording, s.events.extent().duration_s(), s.imu.duration_s());
}

}  // namespace

std::string what_makes_impossible(const std::string& recording, const RecordingSummary& s,
                                  const KnownRig& known, bool whole) {
  if (known.camera != nullptr && known.camera->width > 0 &&
      sensor_fit(s.events, *known.camera) == SensorFit::kOther)
    return describe_other_sensor(recording, s.events, *known.camera);
  return whole ? other_units(recording, s) : "";
}

void judge_recording(const std::string& recording, const RecordingSummary& summary, const KnownRig& known,
                     Time origin, bool whole, Diagnostics& diagnostics) {
  judge_events(summary, known, diagnostics);
  if (summary.imu.count < 2) {
    diagnostics.warn("no_imu", fmt::format("{} IMU data: 'idol segment' works without, 'idol run' does not",
                                           summary.imu.count == 0 ? "no" : "a single sample of"));
    return;
  }
  if (summary.imu.first == summary.imu.last) {
    diagnostics.warn("equal_stamps",
                     fmt::format("all {} IMU samples have one stamp: were they printed with too few digits?",
                                 summary.imu.count));
    return;
  }
  judge_rate(summary, known, diagnostics);
  judge_imu(summary, origin, whole, diagnostics);
  if (const std::string why = whole ? other_units(recording, summary) : ""; !why.empty())
    diagnostics.warn("clock_speed", why + "; a run will refuse");
  else
    judge_clocks(summary, known, whole, diagnostics);
}

Diagnostics check_recording(const std::filesystem::path& sequence, ReaderOptions reading, const Rig& rig) {
  constexpr double kMostS = 60;
  constexpr std::int64_t kMostEvents = 30'000'000, kFewEvents = 1'000'000;
  reading.imu_near_events = false;
  const auto reader = open_reader(sequence, reading);
  RecordingSummary summary(rig.camera.width, rig.camera.height);
  bool whole = true;
  try {
    while (const auto packet = reader->next()) {
      summary.add(*packet);
      const StreamExtent& events = summary.events.extent();
      // Few events in a long time are soon read, or stamped in another unit.
      whole = events.count < kMostEvents && (events.duration_s() < kMostS || events.count < kFewEvents);
      if (!whole) break;
    }
  } catch (const DataError&) {
    whole = false;
  }
  const KnownRig known{&rig.camera, &rig};
  if (const std::string why = what_makes_impossible(sequence.string(), summary, known, whole); !why.empty())
    throw DataError(why);
  Diagnostics diagnostics;
  judge_recording(sequence.string(), summary, known, reader->first_stamp(), whole, diagnostics);
  return diagnostics;
}

}  // namespace idol
