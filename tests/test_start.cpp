// Starts that are not at rest: in the midst of a motion, gliding, or too violent for the IMU to tell what is
// up.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "idol/base/diagnostics.hpp"
#include "pipeline_util.hpp"

namespace idol::test {
namespace {

// What is after `from_s`.
SimulatedRecording cut(SimulatedRecording data, double from_s) {
  const auto before = [&](const auto& x) { return x.t < from_seconds(from_s); };
  std::erase_if(data.events, before);
  std::erase_if(data.imu, before);
  std::erase_if(data.truth, before);
  return data;
}

// Of the newest velocity, in the IMU's frame [m/s].
double velocity_error(const NavState& state, const std::vector<NavState>& truth) {
  const auto it = std::lower_bound(truth.begin(), truth.end(), state.t,
                                   [](const NavState& s, Time t) { return s.t < t; });
  const NavState& now = it == truth.end() ? truth.back() : *it;
  return (state.T_w_i.q.conjugate() * state.v_w - now.T_w_i.q.conjugate() * now.v_w).norm();
}

TEST(PipelineStart, InTheMidstOfAMotion) {
  constexpr double kKnown = 2.5;  // [s]
  const Rig rig = davis_rig();
  HandMotion gentle;
  gentle.speed = 0.5;
  gentle.duration_s = 10;
  const auto whole = record(rig, gentle);
  for (const double from : {3.0, 3.8, 4.6, 5.4}) {
    const auto data = cut(whole, from);
    std::vector<NavState> causal;
    const auto states = estimate(rig, data, 5000, "realtime", &causal);
    ASSERT_GT(states.size(), 60U);
    EXPECT_LT(judge(states, data.truth).position_m, 0.01) << "from " << from;
    double worst = 0;
    for (const auto& s : causal)
      if (seconds_between(states.front().t, s.t) > kKnown)
        worst = std::max(worst, velocity_error(s, data.truth));
    EXPECT_LT(worst, 0.03) << "from " << from;
  }
}

// At an even speed the IMU is as quiet as at rest.
TEST(PipelineStart, AGlideIsNoRest) {
  constexpr double kSpacing = 0.04, kGlide = 1.2, kSpeed = 0.4;  // [s], [s], [m/s]
  const Rig rig = davis_rig();
  const Scene scene = shapes();
  const Pose start = starting_camera(scene) * rig.T_i_c.inverse();
  std::vector<Pose> control;
  for (double t = 0; t < 5; t += kSpacing) {
    const double s = std::max(0.0, t - kGlide), swing = 0.25 * std::sin(3 * s);
    Pose pose = start;
    pose.p += Vec3(0.1 * (1 - std::cos(4 * s)),
                   kSpeed * (std::min(t, kGlide) - kGlide / 2) + kSpeed / 3 * std::sin(3 * s), swing / 2);
    pose.q = pose.q * quat_exp(Vec3(0.5 * swing, 0, 0.5 * swing));
    control.push_back(pose);
  }
  const auto data = simulate_in_memory(scene, Spline(control, kSpacing), rig, {});
  ImuInit init = initialise_from_imu(std::span(data.imu).first(400), 9.81, {});
  ASSERT_TRUE(init.still);  // so the IMU says
  const auto states = estimate(rig, data, 5000, "realtime");
  ASSERT_GT(states.size(), 60U);
  EXPECT_LT(judge(states, data.truth).position_m, 0.02);
  EXPECT_LT(velocity_error(states.back(), data.truth), 0.03);
}

TEST(PipelineStart, AViolentOneIsWaitedOut) {
  constexpr double kViolent = 0.5, kForEver = 1e9;  // [s]
  const Rig rig = davis_rig();
  const auto data = cut(record(rig, 5), 1.5);
  const auto run = [&](double until_s, double share) {
    auto readings = data.imu;
    for (auto& sample : readings)
      if (seconds_between(readings.front().t, sample.t) < until_s) sample.accel *= share;
    auto odometry = std::make_unique<Odometry>(rig, preset("realtime"));
    for (const auto& s : readings) odometry->push(s);
    odometry->push(data.events);
    return odometry;
  };
  const auto late = run(kViolent, 0.1);
  late->finish();
  EXPECT_EQ(late->diagnostics().entries().count("late_start"), 1U);
  ASSERT_TRUE(late->started());
  EXPECT_GT(seconds_between(data.imu.front().t, late->smoother().states().front().t), 0.1);

  const auto never = run(kForEver, 0.5);
  EXPECT_THROW(never->finish(), DataError);
  EXPECT_THROW(static_cast<void>(run(kForEver, 1 / 9.81)), DataError);  // readings in g: said at once
}

}  // namespace
}  // namespace idol::test
