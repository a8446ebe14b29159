// The whole method on a synthetic scene: accuracy against exact truth, and the same bits however the data
// arrive.
#include <gtest/gtest.h>
#include <malloc.h>

#include <cmath>
#include <numeric>

#include "pipeline_util.hpp"

namespace idol::test {
namespace {

class PipelineOf : public ::testing::TestWithParam<std::string_view> {};
INSTANTIATE_TEST_SUITE_P(Presets, PipelineOf, ::testing::Values("realtime", "paper"),
                         [](const auto& tested) { return std::string(tested.param); });

TEST_P(PipelineOf, FindsTheTrajectoryOfASyntheticScene) {
  const Rig rig = davis_rig();
  const auto data = record(rig, 4);
  std::vector<NavState> causal;
  const auto states = estimate(rig, data, 1000, GetParam(), &causal);
  ASSERT_GT(states.size(), 35U);
  EXPECT_EQ(causal.size() + 1, states.size());
  EXPECT_GT(states.back().t, from_seconds(3.9));
  const Errors smoothed = judge(states, data.truth);
  EXPECT_LT(smoothed.position_m, 0.03);
  EXPECT_LT(smoothed.rotation_deg, 2.0);
  EXPECT_LT(judge(causal, data.truth).position_m, 0.05);
  // By comparison: the wander covers decimetres.
  double reach = 0;
  for (const auto& s : data.truth) reach = std::max(reach, (s.T_w_i.p - data.truth.front().T_w_i.p).norm());
  EXPECT_GT(reach, 0.1);
}

TEST_P(PipelineOf, SameBitsTwiceForAnyPacketSizeAndNumberOfThreads) {
  const Rig rig = davis_rig();
  const auto data = record(rig, 2);
  const auto reference = estimate(rig, data, 1000, GetParam());
  ASSERT_GT(reference.size(), 10U);
  for (std::size_t chunk : {std::size_t{1000}, std::size_t{7}, data.events.size()}) {
    const auto other = estimate(rig, data, chunk, GetParam(), nullptr, chunk == 7 ? 1 : 2);
    ASSERT_EQ(other.size(), reference.size()) << "packets of " << chunk;
    for (std::size_t k = 0; k < reference.size(); ++k) {
      ASSERT_EQ(other[k].t, reference[k].t);
      ASSERT_EQ(other[k].T_w_i.p, reference[k].T_w_i.p) << "packets of " << chunk << ", state " << k;
      ASSERT_EQ(other[k].T_w_i.q.coeffs(), reference[k].T_w_i.q.coeffs())
          << "packets of " << chunk << ", state " << k;
      ASSERT_EQ(other[k].v_w, reference[k].v_w);
    }
  }
}

TEST(Pipeline, AWrongTimeOffsetIsFound) {
  constexpr double kWrong = 0.003;  // [s]
  Rig rig = davis_rig();
  const auto data = record(rig, 5);
  const auto right = estimate(rig, data, 5000, "realtime");
  rig.time_offset_s += kWrong;
  const auto states = estimate(rig, data, 5000, "realtime");
  EXPECT_NEAR(states.back().time_shift, right.back().time_shift - kWrong, 5e-4);
  EXPECT_LT(judge(states, data.truth).position_m, 1.2 * judge(right, data.truth).position_m + 5e-4);
}

// The offset that the rig does not know belongs to the stamps of the camera, not to its path.
TEST(Pipeline, CameraPosesAreByTheCamerasClock) {
  constexpr double kOffset = 0.006;  // [s]
  Rig rig = davis_rig();
  rig.time_offset_s = kOffset;
  const auto data = record(rig, 5);
  rig.time_offset_s = 0.001;
  Odometry odometry(rig, preset("realtime"));
  for (const auto& s : data.imu) odometry.push(s);
  odometry.push(data.events);
  odometry.finish();
  const Backend& smoother = odometry.smoother();
  std::vector<NavState> seen = smoother.states();  // the IMU when the camera's clock reads t
  for (NavState& state : seen) {
    const StampedPose camera = smoother.camera_pose(state);
    EXPECT_EQ(camera.t, state.t - from_seconds(rig.time_offset_s));
    state.t = camera.t;
    state.T_w_i = camera.T * rig.T_i_c.inverse();
  }
  const Errors right = judge(seen, data.truth), unaware = judge(smoother.states(), data.truth);
  EXPECT_LT(right.position_m, 0.7 * unaware.position_m);
}

TEST(Pipeline, LagModeKeepsGoingAfterTheBatch) {
  const Rig rig = davis_rig();
  const auto data = record(rig, 4);
  Options options = preset("paper");
  options.backend.batch_s = 2;
  options.backend.lag_windows = 15;
  Odometry odometry(rig, options);
  for (const auto& s : data.imu) odometry.push(s);
  odometry.push(data.events);
  odometry.finish();
  const Errors errors = judge(odometry.smoother().states(), data.truth);
  EXPECT_LT(errors.position_m, 0.08);
  EXPECT_LT(errors.rotation_deg, 4.0);
}

// What a window has measured goes when no last pass will need it.
TEST(Pipeline, MemoryHardlyGrowsWithTheLengthOfARun) {
  const Rig rig = davis_rig();
  const auto data = record(rig, 8);
  Options options = preset("realtime");
  options.pipeline.threads = 1;
  options.backend.last_pass_s = 2;
  Odometry odometry(rig, options);
  std::vector<double> used_kb;
  odometry.on_estimate(
      [&](const Estimate&) { used_kb.push_back(static_cast<double>(mallinfo2().uordblks) / 1e3); });
  feed(odometry, data, 1);
  const auto mean = [&](std::size_t from) {
    return std::accumulate(&used_kb[from], &used_kb[from] + 40, 0.0) / 40;
  };
  ASSERT_GT(used_kb.size(), 150U);
  EXPECT_NEAR(mean(used_kb.size() - 40), mean(60), 200);
}

// The same with and without being told early, and nothing kept waiting.
TEST(Pipeline, ImuThatEndsBeforeTheEvents) {
  const Rig rig = davis_rig();
  auto data = record(rig, 1.5);
  std::erase_if(data.imu, [](const ImuSample& s) { return s.t > from_seconds(1); });
  std::vector<std::vector<NavState>> results;
  for (const bool told : {false, true}) {
    Odometry odometry(rig, Options{});
    for (const auto& s : data.imu) odometry.push(s);
    if (told) odometry.end_imu();
    odometry.push(data.events);
    if (told) {
      EXPECT_EQ(odometry.diagnostics().entries().count("imu_ends_early"), 1U);
    }
    odometry.finish();
    EXPECT_EQ(odometry.diagnostics().entries().count("imu_ends_early"), 1U);
    results.push_back(odometry.smoother().states());
  }
  ASSERT_EQ(results[0].size(), results[1].size());
  EXPECT_NEAR(seconds_between(0, results[0].back().t), 1, 0.01);
  for (std::size_t k = 0; k < results[0].size(); ++k) EXPECT_EQ(results[0][k].T_w_i.p, results[1][k].T_w_i.p);

  Odometry without(rig, Options{});
  without.end_imu();
  without.push(data.events);
  without.finish();
  EXPECT_FALSE(without.started());
  EXPECT_EQ(without.diagnostics().entries().count("no_imu"), 1U);
}

TEST(Pipeline, NoEventsGiveNoEstimateAndNoCrash) {
  const Rig rig = davis_rig();
  Odometry odometry(rig, Options{});
  odometry.push(std::span<const Event>{});
  odometry.finish();
  EXPECT_FALSE(odometry.started());
  EXPECT_FALSE(odometry.predict_at(0));
}

}  // namespace
}  // namespace idol::test
