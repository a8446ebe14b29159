// Prints the accuracy figures of docs/results_preintegration.md:
//   study_preintegration [IMU_FILE]
// IMU_FILE: a recording at 1 kHz (rpg_shapes_rotation/imu.txt) for the part on real data.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cstdio>
#include <exception>
#include <functional>
#include <string>

#include "idol/base/median.hpp"
#include "idol/io/imu_stream.hpp"
#include "idol/io/text_recording.hpp"
#include "reference_preintegration.hpp"
#include "sine_motion.hpp"

namespace idol::bench {
namespace {

constexpr int kWindows = 100;
constexpr int kMargin = 10;
constexpr double kDeg = 180 / std::numbers::pi;

struct Errors {
  std::vector<double> angle, velocity, position;  // [deg], [mm/s], [mm]
  void add(const Motion& estimate, const Motion& truth) {
    angle.push_back(kDeg * so3_log(truth.dR.transpose() * estimate.dR).norm());
    velocity.push_back(1e3 * (truth.dv - estimate.dv).norm());
    position.push_back(1e3 * (truth.dp - estimate.dp).norm());
  }
  [[nodiscard]] std::string row() const {
    return fmt::format("{:.3g} / {:.3g} / {:.3g}", median(angle), median(velocity), median(position));
  }
};

struct Setting {
  const MotionKind& kind;
  double rate;
  bool noisy;
  [[nodiscard]] double gyro_sigma() const { return noisy ? 0.002 : 0; }
  [[nodiscard]] double accel_sigma() const { return noisy ? 0.02 : 0; }
};

ImuNoise noise_of(double rate) {
  ImuNoise noise;
  noise.gyro_density = 0.002 / std::sqrt(rate);
  noise.accel_density = 0.02 / std::sqrt(rate);
  return noise;
}

// One second of a motion of its own for each window, from a sample to a sample.
std::vector<ImuSample> window_readings(const Setting& s, int window, bool noisy) {
  const SineMotion motion(s.kind, static_cast<unsigned>(window));
  return readings(motion, 1 - kMargin / s.rate, 2 + kMargin / s.rate, s.rate, noisy ? 0.002 : 0,
                  noisy ? 0.02 : 0, static_cast<unsigned>(window));
}

using Integrator = std::function<Motion(const std::vector<ImuSample>&, double rate)>;

Integrator by(PreintegrationMethod method) {
  return [method](const std::vector<ImuSample>& samples, double rate) {
    PreintegrationOptions options;
    options.method = method;
    return Preintegration(samples, from_seconds(1), from_seconds(2), {}, noise_of(rate), options)
        .motion(from_seconds(2));
  };
}

Integrator textbook(bool midpoint) {
  return [midpoint](const std::vector<ImuSample>& samples, double) -> Motion {
    return forster(std::span(samples).subspan(kMargin, samples.size() - 2 * kMargin), 0, 0, midpoint);
  };
}

Motion dense(const std::vector<ImuSample>& samples, double) {
  return dense_gpm(samples, kMargin, samples.size() - 1 - kMargin, 1e-6, 1e-6, 20);
}

std::string medians(const Setting& s, const Integrator& integrate) {
  Errors errors;
  for (int i = 0; i < kWindows; ++i)
    errors.add(integrate(window_readings(s, i, s.noisy), s.rate),
               SineMotion(s.kind, static_cast<unsigned>(i)).truth(1, 2));
  return errors.row();
}

// What the samples' noise alone does: with it against without it.
std::string noise_floor(const Setting& s) {
  if (!s.noisy) return "0";
  Errors errors;
  const Integrator integrate = by(PreintegrationMethod::kContinuous);
  for (int i = 0; i < kWindows; ++i)
    errors.add(integrate(window_readings(s, i, true), s.rate),
               integrate(window_readings(s, i, false), s.rate));
  return errors.row();
}

void print_motions() {
  fmt::print(R"(## Simulated motion
Euler angles and position are sums of three sines an axis, as in the simulation of UGPM's authors; 100 windows of 1 s, each of a motion of its
own. Noise of 0.002 rad/s and 0.02 m/s^2 a sample. Median errors of rotation [deg] / velocity [mm/s] / position [mm] at the window's end.

)");
  fmt::print("| motion | mean rate rad/s | median peak rad/s | mean force m/s^2 |\n|---|---|---|---|\n");
  for (const MotionKind& kind : {kFast, kSlow}) {
    double rate = 0, force = 0;
    std::vector<double> peaks;
    for (int i = 0; i < kWindows; ++i) {
      const SineMotion motion(kind, static_cast<unsigned>(i));
      double peak = 0;
      for (int k = 0; k < 100; ++k) {
        const double w = motion.rate(1 + 0.01 * k).norm();
        rate += w / (100 * kWindows);
        force += motion.force(1 + 0.01 * k).norm() / (100 * kWindows);
        peak = std::max(peak, w);
      }
      peaks.push_back(peak);
    }
    fmt::print("| {} | {:.1f} | {:.1f} (largest {:.1f}) | {:.0f} |\n", kind.name, rate, median(peaks),
               *std::max_element(peaks.begin(), peaks.end()), force);
  }
}

void print_accuracy() {
  fmt::print(
      "\n| motion, Hz, noise | continuous | gpm | lpm | dense GP | midpoint | Euler (Forster) | noise alone "
      "|\n"
      "|---|---|---|---|---|---|---|---|\n");
  for (const MotionKind& kind : {kFast, kSlow})
    for (const double rate : {100.0, 200.0, 1000.0})
      for (const bool noisy : {true, false}) {
        const Setting s{kind, rate, noisy};
        const bool affordable = rate < 1000;
        fmt::print("| {}, {:.0f}, {} | **{}** | {} | {} | {} | {} | {} | {} |\n", kind.name, rate,
                   noisy ? "yes" : "no", medians(s, by(PreintegrationMethod::kContinuous)),
                   medians(s, by(PreintegrationMethod::kGpm)), medians(s, by(PreintegrationMethod::kLpm)),
                   affordable ? medians(s, dense) : "-", medians(s, textbook(true)),
                   medians(s, textbook(false)), noise_floor(s));
      }
}

// Mean normalised error squared over many runs; 9 if the covariance is honest.
void print_consistency() {
  fmt::print(R"(
## Covariance
Mean normalised error squared of (rotation, velocity, position), 9 if the covariance is honest: 1000 motions, each with
noise of its own; spans begin between two samples.
)");
  constexpr int kRuns = 1000;
  fmt::print("\n| motion, Hz | 0.05 s | 0.1 s | 0.5 s | 1 s |\n|---|---|---|---|---|\n");
  for (const MotionKind& kind : {kFast, kSlow})
    for (const double rate : {100.0, 200.0, 1000.0}) {
      fmt::print("| {}, {:.0f} |", kind.name, rate);
      for (const double length : {0.05, 0.1, 0.5, 1.0}) {
        const double t0 = 1.0037, t1 = t0 + length;
        double sum = 0;
        for (int run = 0; run < kRuns; ++run) {
          const SineMotion motion(kind, static_cast<unsigned>(run));
          const auto samples = readings(motion, 1 - kMargin / rate, t1 + 2 * kMargin / rate, rate, 0.002,
                                        0.02, static_cast<unsigned>(run));
          const Preintegration imu(samples, from_seconds(t0), from_seconds(t1), {}, noise_of(rate), {});
          const Motion estimate = imu.motion(from_seconds(t1)), truth = motion.truth(t0, t1);
          Eigen::Matrix<double, 9, 1> e;
          e << truth.dp - estimate.dp, so3_log(estimate.dR.transpose() * truth.dR), truth.dv - estimate.dv;
          sum += e.dot(imu.covariance(from_seconds(t1)).llt().solve(e));
        }
        fmt::print(" {:.2f} |", sum / kRuns);
      }
      fmt::print("\n");
    }
  fmt::print("\n95 % bounds of the mean of {} such errors: {:.2f} to {:.2f}.\n", kRuns,
             9 - 1.96 * std::sqrt(18.0 / kRuns), 9 + 1.96 * std::sqrt(18.0 / kRuns));
}

// The same windows when fewer samples are known beyond their ends.
void print_look_ahead() {
  fmt::print(R"(
## Look-ahead
`continuous`, as above, when fewer samples are known beyond the window's end.
)");
  fmt::print(
      "\n| samples beyond the window's end | 0 | 1 | 2 | 3 | 5 | 7 |\n|---|---|---|---|---|---|---|\n");
  for (const bool noisy : {true, false}) {
    fmt::print("| fast, 100 Hz, {} |", noisy ? "noise" : "no noise");
    for (const int ahead : {0, 1, 2, 3, 5, 7}) {
      Errors errors;
      for (int i = 0; i < kWindows; ++i) {
        auto samples = window_readings({kFast, 100, noisy}, i, noisy);
        samples.resize(samples.size() - static_cast<std::size_t>(kMargin - ahead));
        errors.add(by(PreintegrationMethod::kContinuous)(samples, 100),
                   SineMotion(kFast, static_cast<unsigned>(i)).truth(1, 2));
      }
      fmt::print(" {} |", errors.row());
    }
    fmt::print("\n");
  }
}

struct Damage {
  const char* name;
  std::function<void(std::vector<ImuSample>&, const SineMotion&, std::mt19937&)> apply;
};

double uniform(std::mt19937& rng) { return rng() / 4294967296.0; }

// Readings true at stamps off the grid by up to `share` of the period.
Damage jitter(const char* name, double share) {
  return {name, [share](std::vector<ImuSample>& samples, const SineMotion& motion, std::mt19937& rng) {
            const double period = seconds_between(samples[0].t, samples[1].t);
            for (ImuSample& s : samples) {
              const double t = static_cast<double>(s.t) / kNsPerS;
              const ImuSample moved = motion.reading(t + share * period * (2 * uniform(rng) - 1));
              const ImuSample exact = motion.reading(t);
              s.gyro += moved.gyro - exact.gyro;
              s.accel += moved.accel - exact.accel;
              s.t = moved.t;
            }
          }};
}

void print_damage() {
  fmt::print(R"(
## Odd data
)");
  const std::vector<Damage> damages = {
      {"none", [](auto&, auto&, auto&) {}},
      jitter("stamps off by up to 5 % of the period", 0.05),
      jitter("by up to 20 %", 0.2),
      jitter("by up to 45 %", 0.45),
      {"every 20th sample lost",
       [](auto& samples, auto&, auto& rng) {
         std::erase_if(samples, [&](auto&) { return uniform(rng) < 0.05; });
       }},
      {"every 20th row written twice",
       [](auto& samples, auto&, auto& rng) {
         std::vector<ImuSample> out;
         for (const ImuSample& s : samples) {
           out.push_back(s);
           if (uniform(rng) < 0.05) out.push_back(s);
         }
         samples = out;
       }},
  };
  fmt::print(
      "\n| damage (fast, noise) | 100 Hz continuous | 100 Hz lpm | 200 Hz continuous | 200 Hz lpm |\n"
      "|---|---|---|---|---|\n");
  for (const Damage& damage : damages) {
    fmt::print("| {} |", damage.name);
    for (const double rate : {100.0, 200.0})
      for (const auto method : {PreintegrationMethod::kContinuous, PreintegrationMethod::kLpm}) {
        Errors errors;
        for (int i = 0; i < kWindows; ++i) {
          const Setting s{kFast, rate, true};
          const SineMotion motion(kFast, static_cast<unsigned>(i));
          std::mt19937 rng(static_cast<unsigned>(i) + 1000);
          auto samples = window_readings(s, i, true);
          damage.apply(samples, motion, rng);
          errors.add(by(method)(samples, rate), motion.truth(1, 2));
        }
        fmt::print(" {} |", errors.row());
      }
    fmt::print("\n");
  }
}

std::vector<ImuSample> read_imu(const char* path) {
  Diagnostics diagnostics;
  ImuStream stream(open_imu_text(path, rpg_imu_layout()), {}, diagnostics);
  std::vector<ImuSample> samples;
  for (ImuSample s; stream.next(s);) samples.push_back(s);
  return samples;
}

// The recording without what lies above `cut_hz`: windowed sinc, 0.2 s to each side.
std::vector<ImuSample> low_passed(const std::vector<ImuSample>& samples, double cut_hz) {
  constexpr int kHalf = 200;
  const double period =
      seconds_between(samples.front().t, samples.back().t) / static_cast<double>(samples.size() - 1);
  std::vector<double> weights(2 * kHalf + 1);
  double sum = 0;
  for (int i = -kHalf; i <= kHalf; ++i) {
    const double x = 2 * std::numbers::pi * cut_hz * period * i;
    const double window = 0.5 + 0.5 * std::cos(std::numbers::pi * i / (kHalf + 1));
    sum += weights[static_cast<std::size_t>(i + kHalf)] = window * (i == 0 ? 1 : std::sin(x) / x);
  }
  std::vector<ImuSample> out;
  for (std::size_t k = kHalf; k + kHalf < samples.size(); ++k) {
    ImuSample s{samples[k].t, Vec3::Zero(), Vec3::Zero()};
    for (std::size_t i = 0; i < weights.size(); ++i) {
      s.gyro += weights[i] / sum * samples[k + i - kHalf].gyro;
      s.accel += weights[i] / sum * samples[k + i - kHalf].accel;
    }
    out.push_back(s);
  }
  return out;
}

// Half-second rotations from every `step`-th sample against those from all of them, as rotation vectors
// [deg], one a window; the windows begin at given stamps.
std::vector<Vec3> thinning_errors(const std::vector<ImuSample>& samples, std::span<const Time> begins,
                                  std::size_t step, PreintegrationMethod method) {
  constexpr std::size_t kLength = 500;
  const std::size_t margin = 12 * step;
  std::vector<Vec3> errors;
  for (const Time begin : begins) {
    const auto first = static_cast<std::size_t>(
        std::lower_bound(samples.begin(), samples.end(), begin, [](auto& s, Time t) { return s.t < t; }) -
        samples.begin());
    const auto part = std::span(samples).subspan(first - margin, kLength + 2 * margin + 1);
    std::vector<ImuSample> thin;
    for (std::size_t i = 0; i < part.size(); i += step) thin.push_back(part[i]);
    const Time end = samples[first + kLength].t;
    PreintegrationOptions options;
    const Mat3 full = Preintegration(part, begin, end, {}, {}, options).motion(end).dR;
    options.method = method;
    errors.push_back(
        kDeg * so3_log(full.transpose() * Preintegration(thin, begin, end, {}, {}, options).motion(end).dR));
  }
  return errors;
}

double median_norm(const std::vector<Vec3>& errors) {
  std::vector<double> norms;
  for (const Vec3& e : errors) norms.push_back(e.norm());
  return median(norms);
}

void print_real(const char* path) {
  fmt::print(R"(
## Real data
The minute of 1 kHz readings of `rpg_shapes_rotation` (rates to 14 rad/s), thinned to every 10th (100 Hz) or 5th (200 Hz) sample: median difference
[deg] of half-second rotations from those of all samples by `continuous`. Thinning without a filter folds what lies above half the
new rate into the signal; no method can tell it from motion. Taken out beforehand (windowed sinc, 45 Hz), it leaves each method's own error;
the last column is the difference of the two, the floor set by the sensor.
)");
  const std::vector<ImuSample> raw = read_imu(path);
  const auto smooth = low_passed(raw, 45);
  std::vector<Time> begins;
  for (std::size_t k = 500; k + 1000 < raw.size(); k += 97) begins.push_back(raw[k].t);
  fmt::print(
      "\n| every | data | continuous | gpm | lpm | continuous / lpm | folded content alone |\n"
      "|---|---|---|---|---|---|---|\n");
  for (const std::size_t step : {10, 5}) {
    std::vector<Vec3> folded = thinning_errors(raw, begins, step, PreintegrationMethod::kContinuous);
    const auto interpolation = thinning_errors(smooth, begins, step, PreintegrationMethod::kContinuous);
    for (std::size_t i = 0; i < folded.size(); ++i) folded[i] -= interpolation[i];
    for (const auto* samples : {&raw, &smooth}) {
      const auto error = [&](PreintegrationMethod m) {
        return median_norm(thinning_errors(*samples, begins, step, m));
      };
      const double continuous = error(PreintegrationMethod::kContinuous),
                   lpm = error(PreintegrationMethod::kLpm);
      fmt::print("| {}th | {} | **{:.2g}** | {:.2g} | {:.2g} | {:.3f} | {:.2g} |\n", step,
                 samples == &raw ? "as recorded" : "without what lies above 45 Hz", continuous,
                 error(PreintegrationMethod::kGpm), lpm, continuous / lpm,
                 samples == &raw ? median_norm(folded) : 0.0);
    }
  }
  fmt::print("\n{} windows.\n", begins.size());
}

}  // namespace
}  // namespace idol::bench

int main(int argc, char** argv) {
  using namespace idol::bench;
  try {
    print_motions();
    print_accuracy();
    print_consistency();
    print_look_ahead();
    print_damage();
    if (argc > 1) print_real(argv[1]);
  } catch (const std::exception& e) {
    fmt::print(stderr, "study_preintegration: {}\n", e.what());
    return 1;
  }
  return 0;
}
