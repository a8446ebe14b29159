// A DAVIS-like event camera and an IMU moving through a scene: seeded, with exact truth.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/sim/scene.hpp"
#include "idol/sim/spline.hpp"

namespace idol {

struct SimulatorOptions {
  double contrast_on = 0.28;  ///< change of log intensity that makes an event
  double contrast_off = 0.30;
  double contrast_mismatch = 0.04;  ///< relative standard deviation from pixel to pixel
  double refractory_s = 1e-4;
  double jitter_s = 15e-6;      ///< standard deviation of stamps
  double background_hz = 0.25;  ///< noise events per pixel and second (leak and shot noise)
  int hot_pixels = 8;
  double hot_pixel_hz = 60;
  double drop_share = 0;      ///< of the events, lost at random
  double dark_from_s = 0;     ///< no events from here
  double dark_to_s = 0;       ///< to here
  double max_step_px = 0.35;  ///< image motion between two renderings
  double max_step_s = 2e-3;
  double imu_noise_scale = 1;  ///< on the rig's noise densities; 0 = ideal readings
  ImuBias bias{Vec3(-0.003, 0.002, -0.009), Vec3(0.07, -0.09, 0.04)};
  std::uint64_t seed = 1;
};

/// Simulated data in time order; spans are valid during the call.
struct SimulatorSinks {
  std::function<void(std::span<const Event>)> events;
  std::function<void(const ImuSample&)> imu;
  std::function<void(const NavState&)> truth;  ///< 200 Hz, with the biases of that time
  std::function<void(double)> progress;        ///< seconds done; may be empty
};

/// Plays the whole spline. Camera stamps run from 0; IMU stamps are camera time plus the rig's time offset.
void simulate(const Scene& scene, const Spline& motion, const Rig& rig, const SimulatorOptions& options,
              const SimulatorSinks& sinks);

/// Straight edges of the scene that a camera can see as lines, in the world, with the log contrast to the
/// background.
struct TrueLine {
  Vec3 a, b;
  double contrast;
};
std::vector<TrueLine> true_lines(const Scene& scene);

/// Everything of a short simulation in memory, for tests.
struct SimulatedRecording {
  std::vector<Event> events;
  std::vector<ImuSample> imu;
  std::vector<NavState> truth;
};
SimulatedRecording simulate_in_memory(const Scene& scene, const Spline& motion, const Rig& rig,
                                      const SimulatorOptions& options);

}  // namespace idol
