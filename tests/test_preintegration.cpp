#include "idol/imu/preintegration.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "idol/base/diagnostics.hpp"
#include "idol/imu/gp.hpp"
#include "imu_motion.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::SineMotion;

const Vec3 kGravity(0, 0, -9.81);

ImuNoise nearly_noiseless() {
  ImuNoise noise;
  noise.gyro_density = 1e-7;
  noise.accel_density = 1e-6;
  return noise;
}

PreintegrationOptions with(PreintegrationMethod method) {
  PreintegrationOptions options;
  options.method = method;
  return options;
}

constexpr auto kGpm = PreintegrationMethod::kGpm;
constexpr auto kLpm = PreintegrationMethod::kLpm;
constexpr auto kContinuous = PreintegrationMethod::kContinuous;

Preintegration integrate(const std::vector<ImuSample>& samples, double t0, double t1, const ImuBias& bias = {},
                         const ImuNoise& noise = nearly_noiseless(), const PreintegrationOptions& options = {}) {
  return Preintegration(samples, from_seconds(t0), from_seconds(t1), bias, noise, options);
}

struct Errors {
  double angle, velocity, position;
};
Errors errors_of(const Motion& motion, const NavState& begin, const NavState& truth) {
  Preintegrated whole;
  static_cast<Motion&>(whole) = motion;
  const NavState estimate = predict(begin, whole, {}, kGravity);
  return {quat_log(truth.T_w_i.q.conjugate() * estimate.T_w_i.q).norm(), (truth.v_w - estimate.v_w).norm(),
          (truth.T_w_i.p - estimate.T_w_i.p).norm()};
}

// The samples of [t0, t1] at random distances around the period, with readings true at the stamps.
std::vector<ImuSample> jittered(const SineMotion& motion, double t0, double t1, double period, double jitter,
                                unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> offset(-jitter * period, jitter * period);
  std::vector<ImuSample> out;
  for (double t = t0; t <= t1; t += period) out.push_back(motion.reading(t + offset(rng)));
  return out;
}

TEST(GaussianProcess, IntegralsMatchNumericIntegrationOfValues) {
  Eigen::VectorXd times(40);
  Eigen::MatrixXd values(40, 2);
  for (Eigen::Index i = 0; i < 40; ++i) {
    times[i] = 0.01 * static_cast<double>(i) - 0.1;
    values.row(i) << std::sin(20 * times[i]), 3 + times[i];
  }
  const GaussianProcess gp(times, values, 0.03, 1e-6);
  const double from = -0.02, to = 0.17;
  const int steps = 4000;
  Eigen::VectorXd once = Eigen::VectorXd::Zero(2), twice = Eigen::VectorXd::Zero(2);
  const double h = (to - from) / steps;
  for (int k = 0; k < steps; ++k) {
    const Eigen::VectorXd v = gp.value(from + (k + 0.5) * h);
    twice += once * h + 0.5 * h * h * v;
    once += h * v;
  }
  const Eigen::MatrixX2d analytic = gp.integrals(from, to);
  EXPECT_LT((analytic.col(0) - once).norm(), 1e-8);
  EXPECT_LT((analytic.col(1) - twice).norm(), 1e-8);
  EXPECT_LT((gp.integral(from, to) - once).norm(), 1e-8);
  EXPECT_NEAR(gp.value(0.105)[0], std::sin(20 * 0.105), 1e-3);
}

TEST(Preintegration, ConstantRateAndForceAreExact) {
  std::vector<ImuSample> samples;
  for (int k = 0; k < 60; ++k) samples.push_back({from_seconds(0.005 * k), Vec3(1, 2, 3), Vec3(0, 0, 0)});
  const auto motion = integrate(samples, 0.05, 0.2).at(from_seconds(0.2));
  EXPECT_LT((motion.dv - 0.15 * Vec3(1, 2, 3)).norm(), 1e-9);
  EXPECT_LT((motion.dp - 0.5 * 0.15 * 0.15 * Vec3(1, 2, 3)).norm(), 1e-9);
  EXPECT_LT((motion.dR - Mat3::Identity()).norm(), 1e-12);
}

TEST(Preintegration, PredictsTheTrueMotionAtAnyTime) {
  struct Case {
    PreintegrationMethod method;
    double rate, angle, velocity, position;
  };
  const SineMotion motion{3.0};
  const NavState begin = motion.state(1.0);
  for (const Case& c : {Case{kContinuous, 100, 1e-8, 1e-7, 1e-7}, {kContinuous, 1000, 1e-9, 1e-8, 1e-8},
                        {kGpm, 100, 1e-5, 2e-4, 5e-5}, {kGpm, 1000, 1e-6, 2e-5, 5e-6},
                        {kLpm, 100, 2e-3, 2e-2, 2e-3}, {kLpm, 1000, 2e-5, 2e-4, 2e-5}}) {
    const auto imu =
        integrate(motion.readings(0.8, 1.7, c.rate), 1.0, 1.5, {}, nearly_noiseless(), with(c.method));
    for (double t : {0.95, 1.0, 1.00037, 1.1234, 1.25, 1.5, 1.53}) {
      const Errors e = errors_of(imu.motion(from_seconds(t)), begin, motion.state(t));
      const auto where = testing::Message() << kPreintegrationMethods[static_cast<std::size_t>(c.method)] << " at "
                                            << c.rate << " Hz, " << t << " s";
      EXPECT_LT(e.angle, c.angle) << where;
      EXPECT_LT(e.velocity, c.velocity) << where;
      EXPECT_LT(e.position, c.position) << where;
    }
  }
}

TEST(Preintegration, BulkQueriesGiveTheSameBits) {
  const SineMotion motion{3.0};
  const auto imu = integrate(motion.readings(0.9, 1.6, 200), 1.0, 1.5);
  std::vector<Time> times;
  for (int i = 0; i < 500; ++i) times.push_back(from_seconds(1.0 + 0.001 * i));
  std::vector<Motion> many(times.size());
  imu.motions(times, many);
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Preintegrated one = imu.at(times[i]);
    ASSERT_EQ(one.dR, many[i].dR);
    ASSERT_EQ(one.dv, many[i].dv);
    ASSERT_EQ(one.dp, many[i].dp);
    ASSERT_EQ(one.rate, imu.angular_rate(times[i]));
  }
}

class PreintegrationJacobians : public testing::TestWithParam<PreintegrationMethod> {};

Eigen::VectorXd difference(const Preintegrated& base, const Motion& moved) {
  Eigen::VectorXd out(9);
  out << moved.dp - base.dp, so3_log(base.dR.transpose() * moved.dR), moved.dv - base.dv;
  return out;
}

TEST_P(PreintegrationJacobians, ToTheBiasesMatchReintegration) {
  const SineMotion motion{2.0};
  const ImuBias bias{Vec3(0.01, -0.02, 0.03), Vec3(0.1, -0.2, 0.05)};
  const auto samples = motion.readings(0.4, 1.0, 500, bias);
  const auto again = [&](const ImuBias& b) { return integrate(samples, 0.501, 0.9, b, nearly_noiseless(), with(GetParam())); };
  for (double s : {0.47, 0.5025, 0.6, 0.83}) {
    const Time t = from_seconds(s);
    const Preintegrated base = again(bias).at(t);
    const auto shifted = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
      return difference(base, again({bias.gyro + d.head<3>(), bias.accel + d.tail<3>()}).motion(t));
    };
    Eigen::MatrixXd analytic(9, 6);
    analytic << base.d_p_d_bg, base.d_p_d_ba, base.d_R_d_bg, Mat3::Zero(), base.d_v_d_bg, base.d_v_d_ba;
    test::expect_jacobian(analytic, test::numeric_jacobian(shifted, 6, 1e-4), 1e-5);
  }
}

TEST_P(PreintegrationJacobians, ToTheTimeShiftMatchReintegration) {
  const SineMotion motion{2.0};
  const auto samples = motion.readings(0.3, 1.2, 500);
  const auto at_shift = [&](double d) {
    return integrate(samples, 0.5017 + d, 0.9 + d, {}, nearly_noiseless(), with(GetParam())).at(from_seconds(0.8333 + d));
  };
  const Preintegrated base = at_shift(0);
  const auto shifted = [&](const Eigen::VectorXd& d) { return difference(base, at_shift(d[0])); };
  Eigen::MatrixXd analytic(9, 1);
  analytic << base.d_p_d_shift, base.d_R_d_shift, base.d_v_d_shift;
  // Slopes of straight pieces differ from piece to piece.
  test::expect_jacobian(analytic, test::numeric_jacobian(shifted, 1, 2e-4), GetParam() == kLpm ? 2e-3 : 1e-4);
}

INSTANTIATE_TEST_SUITE_P(AllMethods, PreintegrationJacobians, testing::Values(kGpm, kLpm, kContinuous),
                         [](const auto& one) {
                           return std::string(kPreintegrationMethods[static_cast<std::size_t>(one.param)]);
                         });

TEST(Preintegration, MotionsCompose) {
  const SineMotion motion{3.0};
  const auto samples = motion.readings(0.2, 2.0, 200);
  const Preintegrated first = integrate(samples, 0.5, 1.003).at(from_seconds(1.003));
  const Preintegrated second = integrate(samples, 1.003, 1.6).at(from_seconds(1.6));
  const Preintegrated whole = integrate(samples, 0.5, 1.6).at(from_seconds(1.6));
  const Preintegrated composed = first * second;
  EXPECT_NEAR(composed.dt, whole.dt, 1e-12);
  EXPECT_LT(difference(whole, composed).norm(), 1e-10);
  EXPECT_LT((composed.d_R_d_bg - whole.d_R_d_bg).norm(), 1e-6);
  EXPECT_LT((composed.d_v_d_bg - whole.d_v_d_bg).norm(), 1e-6);
  EXPECT_LT((composed.d_v_d_ba - whole.d_v_d_ba).norm(), 1e-6);
  EXPECT_LT((composed.d_p_d_bg - whole.d_p_d_bg).norm(), 1e-6);
  EXPECT_LT((composed.d_p_d_ba - whole.d_p_d_ba).norm(), 1e-6);
  EXPECT_LT((composed.d_R_d_shift - whole.d_R_d_shift).norm(), 1e-8);
  EXPECT_LT((composed.d_v_d_shift - whole.d_v_d_shift).norm(), 1e-6);
  EXPECT_LT((composed.d_p_d_shift - whole.d_p_d_shift).norm(), 1e-6);
  const Motion none = static_cast<const Motion&>(whole) * inverse(whole);
  EXPECT_LT(none.dv.norm() + none.dp.norm() + std::abs(none.dt) + (none.dR - Mat3::Identity()).norm(), 1e-12);
}

// The linear-time form of the Gaussian process against the dense one over the whole window.
TEST(Preintegration, GpmMatchesTheDenseGaussianProcess) {
  const SineMotion motion{3.0};
  ImuNoise noise;
  noise.gyro_density = 2e-4;
  const auto samples = motion.readings(0.0, 1.0, 100, {}, &noise, 5);
  const auto imu = integrate(samples, 0.3, 0.7, {}, noise, with(kGpm));
  Eigen::VectorXd times(std::ssize(samples));
  Eigen::MatrixXd rates(std::ssize(samples), 3);
  for (Eigen::Index i = 0; i < times.size(); ++i) {
    times[i] = 0.01 * static_cast<double>(i);
    rates.row(i) = samples[static_cast<std::size_t>(i)].gyro;
  }
  const double signal = (rates.rowwise() - rates.colwise().mean()).squaredNorm() / (3.0 * 100);
  const GaussianProcess dense(times, rates, 0.03, 4e-6 / signal);
  for (double t = 0.3; t < 0.7; t += 0.0137)
    EXPECT_LT((imu.angular_rate(from_seconds(t)) - Vec3(dense.value(t))).norm(), 1e-3) << t;
}

TEST(Preintegration, StampsMayBeIrregular) {
  const SineMotion motion{3.0};
  const NavState begin = motion.state(1.0);
  for (double jitter : {0.05, 0.3}) {
    const auto imu = integrate(jittered(motion, 0.7, 1.8, 0.005, jitter, 3), 1.0, 1.5);
    const Errors e = errors_of(imu.motion(from_seconds(1.5)), begin, motion.state(1.5));
    EXPECT_LT(e.angle, 1e-8) << jitter;
    EXPECT_LT(e.velocity, 1e-6) << jitter;
    EXPECT_LT(e.position, 1e-6) << jitter;
  }
}

TEST(Preintegration, LostAndRepeatedSamplesCostLittle) {
  const SineMotion motion{3.0};
  const NavState begin = motion.state(1.0);
  const auto whole = motion.readings(0.7, 1.8, 200);
  std::vector<ImuSample> damaged;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    if (i % 17 == 5) continue;                            // lost
    damaged.push_back(whole[i]);
    if (i % 13 == 2) damaged.push_back(whole[i]);         // said twice
  }
  const auto imu = integrate(damaged, 1.0, 1.5);
  EXPECT_GT(imu.quality().merged, 10);
  EXPECT_EQ(imu.quality().gaps, 0);
  EXPECT_NEAR(imu.quality().longest_gap_s, 0.01, 1e-9);
  const Errors e = errors_of(imu.motion(from_seconds(1.5)), begin, motion.state(1.5));
  EXPECT_LT(e.angle, 1e-8);
  EXPECT_LT(e.velocity, 1e-6);
  EXPECT_LT(e.position, 1e-6);
}

TEST(Preintegration, TheRateMayChange) {
  const SineMotion motion{3.0};
  const NavState begin = motion.state(1.0);
  for (const auto& [before, after] : {std::pair(1000.0, 200.0), std::pair(200.0, 1000.0)}) {
    auto samples = motion.readings(0.5, 1.25, before);
    const auto more = motion.readings(1.25 + 1 / after, 2.0, after);
    samples.insert(samples.end(), more.begin(), more.end());
    const auto imu = integrate(samples, 1.0, 1.6);
    EXPECT_EQ(imu.quality().merged, 0);
    const Errors e = errors_of(imu.motion(from_seconds(1.6)), begin, motion.state(1.6));
    EXPECT_LT(e.angle, 1e-8);
    EXPECT_LT(e.velocity, 1e-7);
    EXPECT_LT(e.position, 1e-7);
  }
}

// The normalised error squared of honest covariances averages to its dimension, at samples and between them.
TEST(Preintegration, CovarianceIsHonest) {
  const SineMotion motion{3.0};
  ImuNoise noise;
  noise.gyro_density = 1e-3;
  noise.accel_density = 1e-2;
  const int runs = 300;
  for (auto [rate, from] : {std::pair(100.0, 0.204), std::pair(500.0, 0.2)}) {
    const NavState begin = motion.state(from);
    for (double length : {0.0237, 0.1037, 0.5}) {
      const NavState truth = motion.state(from + length);
      double sum = 0;
      for (int run = 0; run < runs; ++run) {
        const auto samples = motion.readings(0.1, 0.9, rate, {}, &noise, 100U + static_cast<unsigned>(run));
        const auto imu = integrate(samples, from, from + length, {}, noise);
        const NavState estimate = predict(begin, imu.at(truth.t), {}, kGravity);
        Eigen::Matrix<double, 9, 1> error;
        error << begin.T_w_i.q.conjugate() * (truth.T_w_i.p - estimate.T_w_i.p),
            quat_log(estimate.T_w_i.q.conjugate() * truth.T_w_i.q), begin.T_w_i.q.conjugate() * (truth.v_w - estimate.v_w);
        sum += error.dot(imu.covariance(truth.t).llt().solve(error));
      }
      // The mean of `runs` chi-squares with 9 degrees has standard deviation sqrt(18 / runs).
      EXPECT_NEAR(sum / runs, 9.0, 4 * std::sqrt(18.0 / runs)) << rate << " Hz, " << length << " s";
    }
  }
}

TEST(Preintegration, NoiseBeyondTheRigsIsSeen) {
  const SineMotion motion{1.0};
  ImuNoise said, real;
  said.gyro_density = 2e-4, said.accel_density = 4e-3;
  real.gyro_density = 5 * said.gyro_density, real.accel_density = 3 * said.accel_density;
  const Time t = from_seconds(0.3);
  const auto known = integrate(motion.readings(0.1, 0.4, 1000, {}, &real, 1), 0.2, 0.3, {}, real);
  const auto seen = integrate(motion.readings(0.1, 0.4, 1000, {}, &real, 1), 0.2, 0.3, {}, said);
  const auto usual = integrate(motion.readings(0.1, 0.4, 1000, {}, &said, 1), 0.2, 0.3, {}, said);
  EXPECT_NEAR(seen.quality().noise_ratio, 5, 1);
  EXPECT_NEAR(usual.quality().noise_ratio, 1, 0.2);
  const auto sigma = [&](const Preintegration& imu) { return imu.covariance(t).diagonal().cwiseSqrt().eval(); };
  EXPECT_LT((sigma(seen).cwiseQuotient(sigma(known)).array() - 1).abs().maxCoeff(), 0.25);
  // Quieter than said is not believed, and motion is no noise.
  const auto clean = integrate(motion.readings(0.1, 0.4, 200), 0.2, 0.3, {}, said);
  EXPECT_LT(clean.quality().noise_ratio, 0.5);
  EXPECT_GT((sigma(clean).cwiseQuotient(sigma(usual))).minCoeff(), 0.75);
}

TEST(Preintegration, GapInTheDataInflatesTheCovariance) {
  const SineMotion motion{1.0};
  auto samples = motion.readings(0.0, 1.0, 500);
  const auto whole = integrate(samples, 0.1, 0.9);
  std::erase_if(samples, [](const ImuSample& s) { return s.t > from_seconds(0.3) && s.t < from_seconds(0.7); });
  const auto gapped = integrate(samples, 0.1, 0.9);
  const Time t = from_seconds(0.9);
  EXPECT_GT(gapped.covariance(t).diagonal().minCoeff(), 100 * whole.covariance(t).diagonal().maxCoeff());
  EXPECT_TRUE(gapped.at(t).dp.allFinite());
}

TEST(Preintegration, AFewSamplesWillDo) {
  for (const auto method : {kGpm, kLpm, kContinuous})
    for (int count = 2; count < 12; ++count) {
      std::vector<ImuSample> samples;
      for (int k = 0; k < count; ++k) samples.push_back({from_seconds(0.01 * k), Vec3(1, 2, 3), Vec3(0, 0, 0.5)});
      const double end = 0.01 * (count - 1);
      const auto imu = integrate(samples, 0, end, {}, ImuNoise(), with(method));
      const Preintegrated m = imu.at(from_seconds(end));
      EXPECT_LT((so3_log(m.dR) - Vec3(0, 0, 0.5 * end)).norm(), 1e-9) << count;
      EXPECT_TRUE(m.d_p_d_bg.allFinite());
      EXPECT_TRUE(imu.covariance(from_seconds(end)).allFinite());
      EXPECT_GT(imu.covariance(from_seconds(end)).diagonal().minCoeff(), 0);
    }
}

TEST(Preintegration, GapsAreReported) {
  const SineMotion motion{1.0};
  auto samples = motion.readings(0.0, 1.0, 500);
  std::erase_if(samples, [](const ImuSample& s) { return s.t > from_seconds(0.3) && s.t < from_seconds(0.7); });
  const auto imu = integrate(samples, 0.1, 0.9);
  EXPECT_EQ(imu.quality().gaps, 1);
  EXPECT_NEAR(imu.quality().longest_gap_s, 0.4, 1e-9);
}

TEST(Preintegration, TheLastReadingHoldsWhereTheDataEnd) {
  std::vector<ImuSample> samples;
  for (int k = 0; k <= 20; ++k) samples.push_back({from_seconds(0.01 * k), Vec3(1, 2, 3), Vec3::Zero()});
  const auto imu = integrate(samples, -0.05, 0.35);
  EXPECT_LT((imu.motion(from_seconds(0.35)).dv - 0.4 * Vec3(1, 2, 3)).norm(), 1e-12);
  EXPECT_EQ(imu.quality().gaps, 2);
}

TEST(Preintegration, SaturationInflatesTheCovarianceOfItsAxis) {
  const SineMotion motion{6.0};
  const auto samples = motion.readings(0.0, 1.0, 200);
  auto clipped = samples;
  const double range = 3.0;
  for (auto& s : clipped) s.gyro = s.gyro.cwiseMin(range).cwiseMax(-range);
  PreintegrationOptions known;
  known.gyro_range = range;
  ImuNoise noise;
  const auto free = integrate(samples, 0.1, 0.9, {}, noise);
  EXPECT_EQ(free.quality().saturated, 0);
  const NavState begin = motion.state(0.1), truth = motion.state(0.9);
  for (const auto& options : {PreintegrationOptions(), known}) {
    const auto imu = integrate(clipped, 0.1, 0.9, {}, noise, options);
    EXPECT_GT(imu.quality().saturated, 10);
    const Mat3 inflated = imu.covariance(truth.t).block<3, 3>(3, 3);
    const Mat3 usual = free.covariance(truth.t).block<3, 3>(3, 3);
    EXPECT_GT(inflated.trace(), 100 * usual.trace());
    // The error lies within what the covariance admits.
    const Vec3 error = quat_log((begin.T_w_i.q * Quat(imu.motion(truth.t).dR)).conjugate() * truth.T_w_i.q);
    EXPECT_LT(error.dot(inflated.inverse() * error), 25.0);
  }
}

TEST(Preintegration, TooFewSamplesAreRefused) {
  const std::vector<ImuSample> one(1);
  EXPECT_THROW(integrate(one, 0, 1), DataError);
}

}  // namespace
}  // namespace idol
