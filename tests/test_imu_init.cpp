#include "idol/imu/imu_init.hpp"

#include "idol/base/diagnostics.hpp"
#include "idol/imu/imu_buffer.hpp"
#include "imu_motion.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

std::vector<ImuSample> still_readings(const Quat& q_w_i, const ImuBias& bias, unsigned seed) {
  std::mt19937 rng(seed);
  std::vector<ImuSample> out;
  for (int k = 0; k < 800; ++k) {
    ImuSample s;
    s.t = from_seconds(0.001 * k);
    s.gyro = bias.gyro + test::random_vec3(rng, 0.005);
    s.accel = q_w_i.conjugate() * Vec3(0, 0, 9.81) + bias.accel + test::random_vec3(rng, 0.1);
    out.push_back(s);
  }
  return out;
}

TEST(ImuInit, FindsTiltAndGyroBiasOfAStillStart) {
  std::mt19937 rng(5);
  for (unsigned run = 0; run < 10; ++run) {
    const Quat q = quat_exp(test::random_vec3(rng, 1.0));
    const ImuBias bias{Vec3(0.01, -0.02, 0.005), Vec3::Zero()};
    const ImuInit init = initialise_from_imu(still_readings(q, bias, run), 9.81, {});
    EXPECT_TRUE(init.still);
    EXPECT_LT((init.bias.gyro - bias.gyro).norm(), 1e-3);
    EXPECT_LT((init.q_w_i.conjugate() * Vec3::UnitZ() - q.conjugate() * Vec3::UnitZ()).norm(), 3e-3);
  }
}

TEST(ImuInit, RecognisesAMovingStart) {
  const test::SineMotion motion{1.0};
  const ImuInit init = initialise_from_imu(motion.readings(0, 0.5, 1000), 9.81, {});
  EXPECT_FALSE(init.still);
  EXPECT_EQ(init.bias.gyro, Vec3::Zero());
  const Vec3 up = quat_exp(motion.theta(0)).conjugate() * Vec3::UnitZ();
  EXPECT_LT((init.q_w_i.conjugate() * Vec3::UnitZ() - up).norm(), 0.12);
}

TEST(ImuInit, RefusesReadingsThatAreNotGravity) {
  auto samples = still_readings(Quat::Identity(), {}, 1);
  for (auto& s : samples) s.accel /= 9.81;  // in g
  EXPECT_THROW(initialise_from_imu(samples, 9.81, {}), DataError);
  EXPECT_THROW(initialise_from_imu({samples.data(), 3}, 9.81, {}), DataError);
}

TEST(ImuBuffer, SlicesWithMarginAndReportsGapsAndRepeats) {
  ImuBuffer buffer(0.05);
  for (int k = 0; k < 100; ++k) {
    if (k >= 40 && k < 60) continue;
    ImuSample s;
    s.t = from_seconds(0.01 * k);
    buffer.push(s);
    if (k == 10) buffer.push(s);
  }
  ImuSample bad;
  bad.t = from_seconds(2);
  bad.gyro.x() = std::nan("");
  buffer.push(bad);
  const auto& entries = buffer.diagnostics().entries();
  EXPECT_EQ(entries.at("imu_gap").count, 1);
  EXPECT_EQ(entries.at("imu_stamp_not_increasing").count, 1);
  EXPECT_EQ(entries.at("imu_not_finite").count, 1);
  const auto slice = buffer.slice(from_seconds(0.2), from_seconds(0.25), 2);
  EXPECT_EQ(slice.size(), 6U + 4U);
  EXPECT_EQ(slice.front().t, from_seconds(0.18));
  EXPECT_TRUE(buffer.covers(from_seconds(0.95), 5));
  EXPECT_FALSE(buffer.covers(from_seconds(0.95), 6));
  buffer.drop_before(from_seconds(0.5), 3);
  EXPECT_EQ(buffer.front_time(), from_seconds(0.37));
}

}  // namespace
}  // namespace idol
