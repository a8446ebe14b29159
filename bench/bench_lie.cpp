#include <benchmark/benchmark.h>

#include "idol/base/lie.hpp"

static void quaternion_exponential(benchmark::State& state) {
  idol::Vec3 theta(0.01, -0.02, 0.03);
  for (auto _ : state) benchmark::DoNotOptimize(idol::quat_exp(theta));
}
BENCHMARK(quaternion_exponential);
