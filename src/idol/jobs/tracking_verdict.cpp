#include "idol/jobs/tracking_verdict.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace idol {
namespace {

constexpr double kSecond = 1;

/// The likely cause, by what is seen first on the way from event to landmark.
std::string cause_of(const TrackingFacts& f, const std::string& stages) {
  constexpr double kFewEvents = 2000;  // a second
  constexpr double kNoise = 0.5;       // share of the events
  constexpr double kSlow = 4;          // [px/s]
  const double duration = std::max(f.duration_s, 1e-9);
  const auto events = static_cast<double>(f.events);
  if (events < kFewEvents * duration)
    return fmt::format("too few events ({:.0f} a second): the camera rests, or its thresholds are high",
                       events / duration);
  if (static_cast<double>(f.noise) > kNoise * events)
    return fmt::format(
        "{:.0f} % of the events are noise: raise the camera's thresholds, or give it more light",
        100 * static_cast<double>(f.noise) / events);
  if (f.moving_s > 0.3 * duration || f.restarts > 0) {
    if (f.moving_s > 0 && f.median_speed_px_s < kSlow && f.restarts == 0)
      return fmt::format("edges move at {:.1f} px/s: too slow for depth; move faster", f.median_speed_px_s);
    return "lines are seen, but do not move as the IMU says: check its unit, axes, mounting (T_cam_imu) and "
           "clock";
  }
  return fmt::format("no straight edges in view for long{}{}", stages.empty() ? "" : ": ", stages);
}

}  // namespace

bool nothing_tracked(const TrackingFacts& f) {
  constexpr double kLongEnough = 3;  // [s]: a shorter piece may be all start
  const double judged = f.moving_s >= kSecond ? f.moving_s : f.duration_s;
  return (f.moving_s >= kSecond || f.duration_s >= kLongEnough) && f.tracked_s < kSecond &&
         f.tracked_s < 0.25 * judged;
}

void report_tracking(const TrackingFacts& f, const std::string& stages, Diagnostics& diagnostics) {
  constexpr double kMost = 0.5;
  if (nothing_tracked(f)) {
    diagnostics.warn(
        "nothing_tracked",
        fmt::format("landmarks were in view for {:.1f} of {:.1f} s: the trajectory is the IMU's alone and "
                    "worthless; {}",
                    f.tracked_s, f.duration_s, cause_of(f, stages)));
  } else if (f.restarts > 0) {
    diagnostics.warn(
        "restarted",
        fmt::format("the estimator was lost and began anew {} time{}: parts of the trajectory do not hang "
                    "together; {}",
                    f.restarts, f.restarts == 1 ? "" : "s", cause_of(f, stages)));
  } else if (f.moving_s >= kSecond && f.tracked_s < kMost * f.moving_s) {
    diagnostics.warn(
        "poorly_tracked",
        fmt::format("landmarks were in view for {:.1f} of the {:.1f} s with lines in view: expect little of "
                    "the trajectory; {}",
                    f.tracked_s, f.moving_s, cause_of(f, stages)));
  }
}

}  // namespace idol
