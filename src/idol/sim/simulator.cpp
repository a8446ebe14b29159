#include "idol/sim/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "idol/sim/renderer.hpp"

namespace idol {
namespace {

using Rng = std::mt19937_64;

// Independent streams of random numbers for each purpose, so that changing one does not change the others.
Rng stream(std::uint64_t seed, std::uint64_t purpose) {
  std::seed_seq sequence{seed, purpose};
  return Rng(sequence);
}

Vec3 white(Rng& rng, double sigma) {
  std::normal_distribution<double> normal(0, 1);
  const double x = normal(rng), y = normal(rng), z = normal(rng);
  return sigma * Vec3(x, y, z);
}

// IMU readings and truth along the spline.
class ImuSimulator {
 public:
  ImuSimulator(const Spline& motion, const Rig& rig, const SimulatorOptions& options,
               const SimulatorSinks& sinks)
      : motion_(motion),
        rig_(rig),
        options_(options),
        sinks_(sinks),
        noise_(stream(options.seed, 1)),
        walk_(stream(options.seed, 2)),
        bias_(options.bias) {}

  // Emits everything up to and including time t [s].
  void run_until(double t) {
    const double period = 1 / rig_.imu.rate_hz;
    for (; static_cast<double>(samples_) * period <= t + 1e-12; ++samples_)
      emit(static_cast<double>(samples_) * period);
  }

 private:
  void emit(double t) {
    const Kinematics k = motion_.at(t);
    const double scale = options_.imu_noise_scale, root_rate = std::sqrt(rig_.imu.rate_hz);
    ImuSample s;
    s.t = from_seconds(t) + from_seconds(rig_.time_offset_s);
    s.gyro = k.rate_i + bias_.gyro + white(noise_, scale * rig_.imu.gyro_density * root_rate);
    s.accel = k.T_w_i.q.conjugate() * (k.acceleration_w + Vec3(0, 0, 9.81)) + bias_.accel +
              white(noise_, scale * rig_.imu.accel_density * root_rate);
    if (sinks_.imu) sinks_.imu(s);
    constexpr double kTruthRate = 200;
    if (static_cast<double>(truths_) / kTruthRate <= t + 1e-12) {
      if (sinks_.truth) sinks_.truth({from_seconds(t), k.T_w_i, k.velocity_w, bias_});
      ++truths_;
    }
    bias_.gyro += white(walk_, scale * rig_.imu.gyro_walk / root_rate);
    bias_.accel += white(walk_, scale * rig_.imu.accel_walk / root_rate);
  }

  const Spline& motion_;
  const Rig& rig_;
  const SimulatorOptions& options_;
  const SimulatorSinks& sinks_;
  Rng noise_, walk_;
  ImuBias bias_;
  std::int64_t samples_ = 0, truths_ = 0;
};

// Pixels that fire when their log intensity has moved by a threshold since their last event (Mueggler et al.
// 2017).
class EventSensor {
 public:
  EventSensor(const Camera& camera, const SimulatorOptions& options)
      : width_(camera.width),
        options_(options),
        jitter_(stream(options.seed, 3)),
        drop_(stream(options.seed, 4)),
        background_(stream(options.seed, 5)) {
    Rng rng = stream(options.seed, 6);
    std::normal_distribution<double> mismatch(1, options.contrast_mismatch);
    pixels_.resize(static_cast<std::size_t>(camera.width * camera.height));
    for (auto& p : pixels_) {
      p.on = static_cast<float>(options.contrast_on * std::max(0.2, mismatch(rng)));
      p.off = static_cast<float>(options.contrast_off * std::max(0.2, mismatch(rng)));
    }
    const double pixels = static_cast<double>(pixels_.size());
    noise_hz_ = options.background_hz * pixels;
    for (int k = 0; k < options.hot_pixels; ++k) hot_.push_back(rng() % pixels_.size());
  }

  void start(const std::vector<float>& intensity) {
    for (std::size_t i = 0; i < pixels_.size(); ++i)
      pixels_[i].reference = pixels_[i].level = log_level(intensity[i]);
  }

  // Events of (t0, t1], the intensity going from the last one to this one in a straight line of its
  // logarithm.
  void step(const std::vector<float>& intensity, double t0, double t1, std::vector<Event>& out) {
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      Pixel& p = pixels_[i];
      if (intensity[i] == p.intensity) continue;
      p.intensity = intensity[i];
      const float now = log_level(intensity[i]);
      fire(i, p, now, t0, t1, out);
      p.level = now;
    }
    add_noise(t0, t1, out);
  }

 private:
  struct Pixel {
    float on = 0, off = 0;  // thresholds
    float reference = 0;    // log intensity at the last event
    float level = 0;        // log intensity now
    float intensity = -1;
    double last = -1;  // time of the last event [s]
  };

  static float log_level(float intensity) { return std::log(intensity + 0.01F); }

  void fire(std::size_t i, Pixel& p, float now, double t0, double t1, std::vector<Event>& out) {
    const float slope = now - p.level;
    if (slope == 0) return;
    const bool up = slope > 0;
    const float step = up ? p.on : -p.off;
    while (up ? now >= p.reference + step : now <= p.reference + step) {
      p.reference += step;
      const double share = std::clamp(static_cast<double>((p.reference - p.level) / slope), 0.0, 1.0);
      const double t = t0 + share * (t1 - t0);
      if (t - p.last < options_.refractory_s) continue;
      p.last = t;
      emit(i, t, up, t0, t1, out);
    }
  }

  void emit(std::size_t i, double t, bool polarity, double t0, double t1, std::vector<Event>& out) {
    if (t >= options_.dark_from_s && t < options_.dark_to_s) return;
    if (options_.drop_share > 0 && std::uniform_real_distribution<double>(0, 1)(drop_) < options_.drop_share)
      return;
    // Jitter is kept inside the step: the stream stays in order without a look-ahead.
    const double moved =
        std::clamp(t + options_.jitter_s * std::normal_distribution<double>(0, 1)(jitter_), t0, t1);
    const auto width = static_cast<std::size_t>(width_);
    const Time stamp = (from_seconds(moved) + 500) / 1000 * 1000;  // the sensor's clock ticks in microseconds
    out.push_back(
        {stamp, static_cast<std::uint16_t>(i % width), static_cast<std::uint16_t>(i / width), polarity});
  }

  void add_noise(double t0, double t1, std::vector<Event>& out) {
    std::uniform_real_distribution<double> time(t0, t1);
    const auto count = [&](double hz) { return std::poisson_distribution<int>(hz * (t1 - t0))(background_); };
    for (int k = noise_hz_ > 0 ? count(noise_hz_) : 0; k > 0; --k)
      emit(background_() % pixels_.size(), time(background_), background_() % 2 == 0, t0, t1, out);
    for (std::size_t i : hot_)
      for (int k = count(options_.hot_pixel_hz); k > 0; --k)
        emit(i, time(background_), background_() % 2 == 0, t0, t1, out);
  }

  int width_;
  SimulatorOptions options_;
  Rng jitter_, drop_, background_;
  std::vector<Pixel> pixels_;
  std::vector<std::size_t> hot_;
  double noise_hz_ = 0;
};

}  // namespace

void simulate(const Scene& scene, const Spline& motion, const Rig& rig, const SimulatorOptions& options,
              const SimulatorSinks& sinks) {
  Renderer renderer(scene, rig.camera);
  EventSensor sensor(rig.camera, options);
  ImuSimulator imu(motion, rig, options, sinks);
  const auto camera_at = [&](double t) { return motion.at(t).T_w_i * rig.T_i_c; };
  sensor.start(renderer.render(camera_at(0)));
  std::vector<Event> events;
  const double end = motion.duration();
  double t = 0, step = options.max_step_s;
  while (t < end) {
    // The largest step that moves no corner by more than the limit, found by halving.
    step = std::min({2 * step, options.max_step_s, end - t});
    while (step > 2e-5 && renderer.motion_px(camera_at(t), camera_at(t + step)) > options.max_step_px)
      step /= 2;
    events.clear();
    sensor.step(renderer.render(camera_at(t + step)), t, t + step, events);
    std::stable_sort(events.begin(), events.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
    if (sinks.events) sinks.events(events);
    t += step;
    imu.run_until(t);
    if (sinks.progress) sinks.progress(t);
  }
}

std::vector<TrueLine> true_lines(const Scene& scene) {
  std::vector<TrueLine> out;
  for (const auto& shape : scene.shapes) {
    if (shape.curved) continue;
    const double contrast = std::abs(std::log((shape.brightness + 0.01) / (scene.background + 0.01)));
    for (std::size_t i = 0; i < shape.outline.size(); ++i)
      out.push_back({shape.outline[i], shape.outline[(i + 1) % shape.outline.size()], contrast});
  }
  return out;
}

SimulatedRecording simulate_in_memory(const Scene& scene, const Spline& motion, const Rig& rig,
                                      const SimulatorOptions& options) {
  SimulatedRecording out;
  simulate(scene, motion, rig, options,
           {[&](std::span<const Event> e) { out.events.insert(out.events.end(), e.begin(), e.end()); },
            [&](const ImuSample& s) { out.imu.push_back(s); },
            [&](const NavState& s) { out.truth.push_back(s); },
            {}});
  return out;
}

}  // namespace idol
