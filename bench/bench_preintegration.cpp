// Build time of one second of IMU data and time of one query, beside textbook methods.
#include <benchmark/benchmark.h>

#include "reference_preintegration.hpp"
#include "sine_motion.hpp"

namespace {

using namespace idol;
using bench::SineMotion;

constexpr double kGyroSigma = 0.002, kAccelSigma = 0.02;  // a sample
constexpr int kMargin = 8;

/// One second of readings with a margin on both sides.
struct Window {
  std::vector<ImuSample> samples;
  Time begin = from_seconds(1), end = from_seconds(2);
  ImuNoise noise;
  double rate;

  explicit Window(benchmark::State& state) : rate(static_cast<double>(state.range(0))) {
    samples = bench::readings(SineMotion(bench::kFast, 1), 1 - kMargin / rate, 2 + kMargin / rate, rate,
                              kGyroSigma, kAccelSigma, 1);
    noise.gyro_density = kGyroSigma / std::sqrt(rate);
    noise.accel_density = kAccelSigma / std::sqrt(rate);
  }
  [[nodiscard]] Preintegration integrate(PreintegrationMethod method) const {
    PreintegrationOptions options;
    options.method = method;
    return {samples, begin, end, {}, noise, options};
  }
  [[nodiscard]] std::span<const ImuSample> inside() const {
    return std::span(samples).subspan(kMargin, samples.size() - 2 * kMargin);
  }
};

void build(benchmark::State& state, PreintegrationMethod method) {
  const Window window(state);
  for (auto _ : state) benchmark::DoNotOptimize(window.integrate(method));
}

void build_forster(benchmark::State& state) {
  const Window window(state);
  for (auto _ : state)
    benchmark::DoNotOptimize(
        bench::forster(window.inside(), window.noise.gyro_density, window.noise.accel_density, false));
}

void build_dense_gp(benchmark::State& state) {
  const Window window(state);
  const std::size_t last = window.samples.size() - 1 - kMargin;
  for (auto _ : state) benchmark::DoNotOptimize(bench::dense_gpm(window.samples, kMargin, last, 1e-6, 1e-6));
}

std::vector<Time> spread_times(const Window& window) {
  std::vector<Time> times;
  for (int i = 0; i < 1000; ++i)
    times.push_back(window.begin + (window.end - window.begin) / 1000 * i + 123456);
  return times;
}

// Times jump about, so that no query profits from the one before.
void query(benchmark::State& state, PreintegrationMethod method) {
  const Window window(state);
  const Preintegration imu = window.integrate(method);
  const std::vector<Time> times = spread_times(window);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(imu.at(times[i = (i + 379) % times.size()]));
}

void query_covariance(benchmark::State& state, PreintegrationMethod method) {
  const Window window(state);
  const Preintegration imu = window.integrate(method);
  const std::vector<Time> times = spread_times(window);
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(imu.covariance(times[i = (i + 379) % times.size()]));
}

void query_bulk(benchmark::State& state, PreintegrationMethod method) {
  const Window window(state);
  const Preintegration imu = window.integrate(method);
  const std::vector<Time> times = spread_times(window);
  std::vector<Motion> out(times.size());
  for (auto _ : state) {
    imu.motions(times, out);
    benchmark::DoNotOptimize(out.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * std::ssize(times));
}

#define FOR_EACH_METHOD(function)                                            \
  BENCHMARK_CAPTURE(function, gpm, PreintegrationMethod::kGpm)               \
      ->ArgName("Hz")                                                        \
      ->Arg(100)                                                             \
      ->Arg(200)                                                             \
      ->Arg(1000);                                                           \
  BENCHMARK_CAPTURE(function, lpm, PreintegrationMethod::kLpm)               \
      ->ArgName("Hz")                                                        \
      ->Arg(100)                                                             \
      ->Arg(200)                                                             \
      ->Arg(1000);                                                           \
  BENCHMARK_CAPTURE(function, continuous, PreintegrationMethod::kContinuous) \
      ->ArgName("Hz")                                                        \
      ->Arg(100)                                                             \
      ->Arg(200)                                                             \
      ->Arg(1000)

FOR_EACH_METHOD(build);
BENCHMARK(build_forster)->ArgName("Hz")->Arg(100)->Arg(200)->Arg(1000);
BENCHMARK(build_dense_gp)->ArgName("Hz")->Arg(100)->Arg(200)->Arg(1000)->Unit(benchmark::kMillisecond);
FOR_EACH_METHOD(query);
FOR_EACH_METHOD(query_bulk);
FOR_EACH_METHOD(query_covariance);
BENCHMARK_CAPTURE(build, continuous, PreintegrationMethod::kContinuous)->ArgName("Hz")->Arg(8000);

}  // namespace
