#include "idol/io/event_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/median.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {

void StreamExtent::add(Time t) {
  if (count == 0) first = last = t;
  const Time pause = t - last;
  if (pause > longest_pause) {
    longest_pause = pause;
    longest_pause_at = last;
  }
  long_pauses += pause >= kLongPause ? 1 : 0;
  last = t;
  ++count;
}

double StreamExtent::rate_hz() const {
  return last > first ? static_cast<double>(count - 1) / duration_s() : 0.0;
}

void PixelActivity::grow(int x, int y) {
  const int old_stride = stride_;
  const int old_rows = rows_;
  if (stride_ == 0) stride_ = rows_ = 256;
  while (x >= stride_) stride_ *= 2;
  while (y >= rows_) rows_ *= 2;
  std::vector<Pixel> larger(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(rows_));
  for (int row = 0; row < old_rows; ++row) {
    std::copy_n(pixels_.begin() + static_cast<std::ptrdiff_t>(row) * old_stride, old_stride,
                larger.begin() + static_cast<std::ptrdiff_t>(row) * stride_);
  }
  pixels_ = std::move(larger);
}

void EventMonitor::add(std::span<const Event> events) {
  constexpr int kLargestPixel = 8191;  // beyond it no sensor, only damage, and no memory for it
  for (const Event& event : events) {
    extent_.add(event.t);
    on_events_ += event.polarity ? 1 : 0;
    if (width_ > 0 && (event.x >= width_ || event.y >= height_)) ++outside_;
    if (event.x > kLargestPixel || event.y > kLargestPixel) continue;
    largest_x_ = std::max<int>(largest_x_, event.x);
    largest_y_ = std::max<int>(largest_y_, event.y);
    pixels_.add(event.x, event.y, span_of(event.t));
  }
}

std::vector<std::pair<int, int>> EventMonitor::hot_pixels() const {
  constexpr double kLeastShare = 0.65;   // of the spans in which a hot pixel fires
  constexpr double kLargestShare = 0.7;  // the median pixel around it, relative to it
  constexpr std::uint32_t kFewestSpans = 40;
  const std::uint32_t all = extent_.count > 0 ? span_of(extent_.last) : 0;
  std::vector<std::pair<int, int>> hot;
  if (all < kFewestSpans) return hot;
  std::vector<std::uint32_t> around;
  for (int y = 0; y <= largest_y_; ++y) {
    for (int x = 0; x <= largest_x_; ++x) {
      const double spans = pixels_.spans(x, y);
      if (spans < kLeastShare * all) continue;
      around.clear();
      for (int v = std::max(0, y - 2); v <= std::min(largest_y_, y + 2); ++v)
        for (int u = std::max(0, x - 2); u <= std::min(largest_x_, x + 2); ++u)
          if (u != x || v != y) around.push_back(pixels_.spans(u, v));
      if (around.empty()) continue;
      if (median(around) < kLargestShare * spans) hot.emplace_back(x, y);
    }
  }
  return hot;
}

void EventMonitor::report(const std::string& recording, Diagnostics& diagnostics) const {
  if (extent_.long_pauses > 0)
    diagnostics.warn(
        "no_events",
        fmt::format("{}: no event for {:.3f} s from {} s on: the camera stood still, or a part is missing",
                    recording, static_cast<double>(extent_.longest_pause) / kNsPerS,
                    format_stamp(extent_.longest_pause_at)),
        extent_.long_pauses);
  if (const auto hot = hot_pixels(); !hot.empty())
    diagnostics.warn(
        "hot_pixels",
        fmt::format("{}: hot pixel ({}, {}) fires nearly all the time while its neighbours do not", recording,
                    hot[0].first, hot[0].second),
        std::ssize(hot));
}

SensorFit sensor_fit(const EventMonitor& monitor, const Camera& camera) {
  constexpr std::int64_t kEnoughEvents = 100000;
  const int width = monitor.largest_x() + 1;
  const int height = monitor.largest_y() + 1;
  const bool narrow = 4 * width < 3 * camera.width;
  const bool low = 4 * height < 3 * camera.height;
  if (monitor.extent().count < kEnoughEvents || (!narrow && !low)) return SensorFit::kGood;
  if (!narrow || !low) return SensorFit::kPartly;
  constexpr double kFarFromCentre = 0.2;  // of the size
  const bool odd_centre = std::abs(camera.cx - 0.5 * camera.width) > kFarFromCentre * camera.width ||
                          std::abs(camera.cy - 0.5 * camera.height) > kFarFromCentre * camera.height;
  const bool beyond = camera.cx > width || camera.cy > height;
  return odd_centre || beyond ? SensorFit::kOther : SensorFit::kPartly;
}

std::string describe_fit(const EventMonitor& monitor, const Camera& camera) {
  return fmt::format("events fill only {} x {} of the calibration's {} x {}", monitor.largest_x() + 1,
                     monitor.largest_y() + 1, camera.width, camera.height);
}

std::string describe_other_sensor(const std::string& recording, const EventMonitor& monitor,
                                  const Camera& camera) {
  return fmt::format(
      "{}: {}, nor does the principal point ({:.1f}, {:.1f}) fit; give the rig, or the resolution, of this "
      "sensor",
      recording, describe_fit(monitor, camera), camera.cx, camera.cy);
}

void check_sensor_fit(const std::string& recording, const EventMonitor& monitor, const Camera& camera,
                      Diagnostics& diagnostics) {
  const SensorFit fit = sensor_fit(monitor, camera);
  if (fit == SensorFit::kGood) return;
  if (fit == SensorFit::kOther) throw DataError(describe_other_sensor(recording, monitor, camera));
  diagnostics.warn("part_of_sensor", fmt::format("{}: {}: another sensor, or a cut-out", recording,
                                                 describe_fit(monitor, camera)));
}

}  // namespace idol
