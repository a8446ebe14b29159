#include "idol/imu/preintegration.hpp"

#include <Eigen/Cholesky>

#include "idol/base/diagnostics.hpp"
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

Preintegration integrate(const std::vector<ImuSample>& samples, double t0, double t1, const ImuBias& bias = {},
                         const ImuNoise& noise = nearly_noiseless()) {
  return Preintegration(samples, from_seconds(t0), from_seconds(t1), bias, noise, {});
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
  for (double rate : {200.0, 1000.0}) {
    const SineMotion motion{3.0};
    const auto samples = motion.readings(0.9, 1.6, rate);
    const auto imu = integrate(samples, 1.0, 1.5);
    const NavState begin = motion.state(1.0);
    for (double t : {1.0, 1.00037, 1.1234, 1.25, 1.5}) {
      const NavState truth = motion.state(t);
      const NavState estimate = predict(begin, imu.at(from_seconds(t)), {}, kGravity);
      const double scale = 1e6 / (rate * rate);  // of the interpolation error
      EXPECT_LT((truth.T_w_i.p - estimate.T_w_i.p).norm(), 2e-6 * scale) << rate << " " << t;
      EXPECT_LT((truth.v_w - estimate.v_w).norm(), 1e-5 * scale) << rate << " " << t;
      EXPECT_LT(quat_log(truth.T_w_i.q.conjugate() * estimate.T_w_i.q).norm(), 1e-6 * scale) << rate << " " << t;
    }
  }
}

TEST(Preintegration, BiasJacobiansMatchReintegration) {
  const SineMotion motion{2.0};
  const ImuBias bias{Vec3(0.01, -0.02, 0.03), Vec3(0.1, -0.2, 0.05)};
  const auto samples = motion.readings(0.4, 1.0, 500, bias);
  const Time t = from_seconds(0.83);
  const Preintegrated base = integrate(samples, 0.5, 0.9, bias).at(t);
  const auto shifted = [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
    const ImuBias moved{bias.gyro + d.head<3>(), bias.accel + d.tail<3>()};
    const Preintegrated m = integrate(samples, 0.5, 0.9, moved).at(t);
    Eigen::VectorXd out(9);
    out << m.dp, so3_log(base.dR.transpose() * m.dR), m.dv;
    return out;
  };
  const Eigen::MatrixXd numeric = test::numeric_jacobian(shifted, 6, 1e-4);
  Eigen::MatrixXd analytic = Eigen::MatrixXd::Zero(9, 6);
  analytic << base.d_p_d_bg, base.d_p_d_ba, base.d_R_d_bg, Mat3::Zero(), base.d_v_d_bg, base.d_v_d_ba;
  test::expect_jacobian(analytic, numeric, 1e-5);
}

// The normalised error squared of honest covariances averages to its dimension.
TEST(Preintegration, CovarianceIsHonest) {
  const SineMotion motion{2.0};
  ImuNoise noise;
  noise.gyro_density = 1e-3;
  noise.accel_density = 1e-2;
  const NavState begin = motion.state(0.2), truth = motion.state(0.5);
  const int runs = 300;
  double sum = 0;
  for (int run = 0; run < runs; ++run) {
    const auto samples = motion.readings(0.1, 0.6, 500, {}, &noise, 100U + static_cast<unsigned>(run));
    const auto imu = integrate(samples, 0.2, 0.5, {}, noise);
    const NavState estimate = predict(begin, imu.at(truth.t), {}, kGravity);
    Eigen::Matrix<double, 9, 1> error;
    error << begin.T_w_i.q.conjugate() * (truth.T_w_i.p - estimate.T_w_i.p),
        quat_log(estimate.T_w_i.q.conjugate() * truth.T_w_i.q), begin.T_w_i.q.conjugate() * (truth.v_w - estimate.v_w);
    sum += error.dot(imu.covariance(truth.t).llt().solve(error));
  }
  // The mean of `runs` chi-squares with 9 degrees has standard deviation sqrt(18 / runs).
  EXPECT_NEAR(sum / runs, 9.0, 4 * std::sqrt(18.0 / runs));
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

TEST(Preintegration, TooFewSamplesAreRefused) {
  const std::vector<ImuSample> one(1);
  EXPECT_THROW(integrate(one, 0, 1), DataError);
}

}  // namespace
}  // namespace idol
