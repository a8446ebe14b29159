// All options of the estimators.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "idol/base/options.hpp"

namespace idol {

enum class BackendMethod { kBatch, kFixedLag };
constexpr std::array<std::string_view, 2> kBackendMethodNames{"batch", "fixed_lag"};
constexpr std::span<const std::string_view> option_names(BackendMethod) { return kBackendMethodNames; }

struct BackendOptions {
  BackendMethod method = BackendMethod::kFixedLag;
  double event_sigma_px = 1.5;
  double huber_sigmas = 0.7;
  double observation_sigmas = 0.5;
  double repulsion_sigma_px = 10;
  double attraction_sigma = 10;
  int max_events_per_observation = 20;
  int max_lines_per_window = 60;
  int min_windows = 3;
  double first_depth_m = 2.0;
  double depth_prior_log = 3.0;
  double slant_prior_log = 0.5;
  double cull_px = 1.5;
  double bin_s = 0.01;
  int min_bin_events = 5;
  double bin_gate_px = 0.8;
  double bin_sigma_px = 1.2;
  double bin_cauchy_sigmas = 0.2;
  double imu_noise_factor = 2;
  double create_depth_sigma = 0.25;
  double create_rms_px = 1.0;
  int few_lines = 20;
  double redetect_px = 2.5;
  int max_resting_lines = 30;
  double last_pass_s = 600;
  double blind_s = 2;
  double max_speed = 150;
  double max_accel_bias = 3;
  double batch_s = 24;
  int lag_windows = 20;
  int max_iterations = 4;
  bool use_rest = true;
  bool refine_calibration = true;
  bool refine_imu = true;
  bool find_time_offset = true;
  double gravity = 9.81;
  double start_pose_sigma = 1e-4;
  double start_velocity_sigma = 0.01;
  double moving_velocity_sigma = 1.0;
  double gyro_bias_sigma = 0.003;
  double moving_gyro_bias_sigma = 0.06;
  double accel_bias_sigma = 0.2;
  double time_shift_sigma = 0.003;
  double event_lag_sigma_px = 0.2;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("method", self.method, Range{},
          "batch: the paper's; fixed_lag: compressed events, minimal lines, marginal prior");
    visit("event_sigma_px", self.event_sigma_px, Range{0.05, 100},
          "standard deviation of an event-to-line distance [px]");
    visit("huber_sigmas", self.huber_sigmas, Range{0, 100},
          "distances beyond count by their size, not its square; 0: never (the paper)");
    visit("observation_sigmas", self.observation_sigmas, Range{0, 100},
          "Cauchy loss on what one window saw of one line, its RMS in event_sigma_px; 0: none (the paper)");
    visit("repulsion_sigma_px", self.repulsion_sigma_px, Range{0.1, 1e4},
          "standard deviation of the repulsion (paper IV-B) [px]");
    visit("attraction_sigma", self.attraction_sigma, Range{0.1, 1e4},
          "standard deviation of the attraction (paper IV-B) [sqrt px]");
    visit("max_events_per_observation", self.max_events_per_observation, Range{2, 1e6},
          "events used of one segment in one window, evenly spread over its time");
    visit("max_lines_per_window", self.max_lines_per_window, Range{1, 1e6},
          "segments used of one window, longest tracks first");
    visit("min_windows", self.min_windows, Range{1, 100},
          "windows that must see a segment before it becomes a line");
    visit("first_depth_m", self.first_depth_m, Range{0.05, 1000},
          "depth of the first lines, before any is known [m]");
    visit("depth_prior_log", self.depth_prior_log, Range{0.01, 100},
          "standard deviation of the log depth of a new line: weak, keeps lines without parallax bounded");
    visit("slant_prior_log", self.slant_prior_log, Range{0.01, 100},
          "standard deviation of the log ratio of the depths of a new line's ends");
    visit("cull_px", self.cull_px, Range{0.1, 1000}, "an observation with a larger RMS is left out [px]");
    visit("bin_s", self.bin_s, Range{0.001, 0.1},
          "events of a line within this time are compressed to two points [s]");
    visit("min_bin_events", self.min_bin_events, Range{2, 1000}, "fewer events in a bin are not used");
    visit("bin_gate_px", self.bin_gate_px, Range{0.1, 10},
          "events farther from their segment's line are left out of its bins [px]");
    visit(
        "bin_sigma_px", self.bin_sigma_px, Range{0.05, 10},
        "standard deviation of the distance of a bin of many events: their errors are not independent [px]");
    visit("bin_cauchy_sigmas", self.bin_cauchy_sigmas, Range{0.1, 1000}, "scale of the Cauchy loss on a bin");
    visit("imu_noise_factor", self.imu_noise_factor, Range{0.1, 100},
          "the IMU's noise counts so many times, beside the lines: what no noise model knows comes on top");
    visit("create_depth_sigma", self.create_depth_sigma, Range{0.001, 1},
          "relative standard deviation of the inverse depth at which a segment becomes a line");
    visit("create_rms_px", self.create_rms_px, Range{0.1, 100}, "and the largest RMS of its bins then [px]");
    visit("few_lines", self.few_lines, Range{0, 1000},
          "with fewer lines in sight, segments of unknown depth become lines too");
    visit("redetect_px", self.redetect_px, Range{0, 20},
          "a segment this near to a known line's image is that line [px]; 0: no line is ever found again");
    visit("max_resting_lines", self.max_resting_lines, Range{0, 1000},
          "lines out of sight that are remembered");
    visit("last_pass_s", self.last_pass_s, Range{0, 1e6},
          "recordings up to this length get a last pass over everything, for the smoothed trajectory [s]");
    visit("blind_s", self.blind_s, Range{0.1, 1e6},
          "so long in motion without a line of the map, and tracking is lost: the IMU alone drifts [s]");
    visit("max_speed", self.max_speed, Range{0.1, 1e6},
          "a faster estimate means that tracking is lost, not that the camera is so fast [m/s]");
    visit("max_accel_bias", self.max_accel_bias, Range{0.1, 100},
          "so does a larger bias of the accelerometer [m/s^2]");
    visit("batch_s", self.batch_s, Range{0, 1e6},
          "full batch until this time since the start (paper VI) [s]");
    visit("lag_windows", self.lag_windows, Range{2, 1e6},
          "windows optimised at a time: after the batch, the oldest pose fixed (paper VI), or the fixed lag");
    visit("max_iterations", self.max_iterations, Range{1, 1000}, "of the solver per window");
    visit("use_rest", self.use_rest, Range{},
          "where neither image nor IMU moves, the state does not either; false for what glides or floats");
    visit("refine_calibration", self.refine_calibration, Range{},
          "estimate the camera's rotation in the IMU's frame (wrong by up to 5 deg) and focal length (by up "
          "to 2 %) too");
    visit("refine_imu", self.refine_imu, Range{},
          "estimate the IMU's scale errors, misaligned axes and rates by specific force too");
    visit("find_time_offset", self.find_time_offset, Range{},
          "in the first second of motion, look for a rig's time offset that is wrong by up to 150 ms, and "
          "correct it (fixed_lag)");
    visit("gravity", self.gravity, Range{9, 10.5}, "[m/s^2]");
    visit(
        "start_pose_sigma", self.start_pose_sigma, Range{1e-9, 100},
        "of the first position [m] and yaw [rad], which nothing can measure: they are what we say they are");
    visit("start_velocity_sigma", self.start_velocity_sigma, Range{1e-4, 10},
          "velocity while the start is still [m/s]");
    visit("moving_velocity_sigma", self.moving_velocity_sigma, Range{1e-4, 100},
          "first velocity after a moving start [m/s]");
    visit("gyro_bias_sigma", self.gyro_bias_sigma, Range{1e-6, 1},
          "gyro bias found in a still start [rad/s]");
    visit("moving_gyro_bias_sigma", self.moving_gyro_bias_sigma, Range{1e-6, 1},
          "gyro bias after a moving start [rad/s]");
    visit("accel_bias_sigma", self.accel_bias_sigma, Range{1e-6, 10},
          "accelerometer bias at the start [m/s^2]");
    visit("time_shift_sigma", self.time_shift_sigma, Range{1e-9, 1},
          "error of the rig's time offset at the start, estimated on line [s]; 1e-9: the offset is exact");
    visit("event_lag_sigma_px", self.event_lag_sigma_px, Range{1e-9, 10},
          "how far events may trail their edges at any speed, estimated on line [px]; 1e-9: not at all");
  }
};

}  // namespace idol
