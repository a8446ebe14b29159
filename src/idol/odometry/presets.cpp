#include "idol/odometry/presets.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>

namespace idol {
namespace {

constexpr std::array<std::string_view, 2> kNames{"realtime", "paper"};

// Windows by number of events, Gaussian processes, every event a residual, two-point lines, batch.
Options paper() {
  Options options;
  options.window.max_events = 30000;
  options.window.max_duration_s = 0.1;
  options.segment.method = SegmentMethod::kPaper;
  options.segment.min_length_px = 12;
  options.imu.method = PreintegrationMethod::kGpm;
  options.imu.margin_samples = 8;
  options.backend.method = BackendMethod::kBatch;
  options.backend.min_windows = 4;
  options.backend.max_lines_per_window = 40;
  options.backend.max_iterations = 8;
  options.backend.depth_prior_log = 1;
  options.backend.moving_gyro_bias_sigma = 0.03;
  options.backend.start_velocity_sigma = 0.02;
  options.backend.lag_windows = 30;
  return options;
}

}  // namespace

std::span<const std::string_view> preset_names() { return kNames; }

Options preset(std::string_view name) {
  if (name == kNames[0]) return {};
  if (name == kNames[1]) return paper();
  throw UsageError(fmt::format("--preset {}: unknown; there are: {}", name, fmt::join(kNames, ", ")));
}

}  // namespace idol
