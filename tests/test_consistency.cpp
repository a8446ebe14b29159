// The fixed lag on measurements whose errors are exactly what it is told: its covariance must be honest, and
// what nobody can observe must stay unknown.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <functional>
#include <random>

#include "idol/backend/fixed_lag.hpp"
#include "imu_motion.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

constexpr double kBinSigma = 0.3;      // [px]
constexpr double kTimeShift = 0.0008;  // [s]
constexpr double kLag = 0.1;           // [px]
constexpr double kWindow = 0.05;       // [s]
constexpr int kBins = 2, kEvents = 40;
const Vec3 kMove(0.4, 0.3, 0);  // [m]

struct World {
  SineMotion motion;
  Rig rig;
  std::vector<LineEnds> lines;
  ImuBias bias{Vec3(0.004, -0.003, 0.002), Vec3(0.05, -0.08, 0.06)};
  Mat3 gyro_scale = Mat3::Identity(), accel_scale = Mat3::Identity();

  explicit World(std::mt19937& rng) {
    rig.camera = {240, 180, 200, 200, 120, 90};
    rig.T_i_c = {quat_exp(Vec3(0.02, -0.01, 0.03)), Vec3(0.03, 0.01, 0.02)};
    rig.imu.rate_hz = 500;
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (int k = 0; k < 150; ++k) {
      const Vec3 middle(2.5 * uniform(rng), 2.5 * uniform(rng), 2.5 + uniform(rng));
      const Vec3 half(0.3 * uniform(rng), 0.3 * uniform(rng), 0.3 * uniform(rng));
      lines.push_back({middle - half, middle + half});
    }
  }
  [[nodiscard]] std::optional<Vec2> image(const Vec3& point, double t) const {
    const Vec3 x = (motion.state(t).T_w_i * rig.T_i_c).inverse() * point;
    if (x.z() < 0.3) return std::nullopt;
    const Vec2 px = rig.camera.project(x);
    return rig.camera.width > px.x() && px.x() > 0 && px.y() > 0 && px.y() < rig.camera.height
               ? std::optional(px)
               : std::nullopt;
  }
  // As a segmenter and compression without error of their own would see the line at IMU time t: with noise,
  // and behind the line by the lag.
  [[nodiscard]] std::optional<LineBin> see(const LineEnds& line, double t, std::mt19937& rng) const {
    const auto a = image(line.a, t), b = image(line.b, t), a1 = image(line.a, t + 1e-4),
               b1 = image(line.b, t + 1e-4);
    if (!a || !b || !a1 || !b1 || (*b - *a).norm() < 15) return std::nullopt;
    const Vec2 along = (*b - *a).normalized(), across(-along.y(), along.x());
    std::normal_distribution<double> noise(0, kBinSigma * std::sqrt(1 + 1.0 / kEvents));
    LineBin bin{*a, *b, across, across, 0, kEvents};
    for (const auto& [px, now, next, heading] :
         {std::tuple{&bin.a_px, *a, *a1, &bin.a_heading}, std::tuple{&bin.b_px, *b, *b1, &bin.b_heading}}) {
      *heading *= across.dot(next - now) > 0 ? 1 : -1;
      *px += noise(rng) * across - kLag * *heading;
    }
    return bin;
  }
};

BackendOptions honest_options() {
  BackendOptions options;
  options.lag_windows = 10;
  options.bin_sigma_px = kBinSigma;
  options.bin_cauchy_sigmas = 1000;
  options.imu_noise_factor = 1;
  options.refine_calibration = options.refine_imu = false;
  options.redetect_px = 0;
  return options;
}

// The IMU of a window that begins at `begin`, out of samples from -0.1 s on.
std::shared_ptr<const Preintegration> integrate(std::span<const ImuSample> samples, double begin,
                                                const ImuBias& bias, const ImuNoise& noise) {
  const double end = begin + kWindow;
  const auto from = static_cast<std::size_t>((begin + 0.08) * noise.rate_hz),
             to = static_cast<std::size_t>((end + 0.12) * noise.rate_hz);
  return std::make_shared<Preintegration>(samples.subspan(from, to - from), from_seconds(begin),
                                          from_seconds(end), bias, noise, PreintegrationOptions{});
}

// Runs the estimator over some seconds from a first state that is off by what its prior allows. From
// `moved_at` on all lines are elsewhere.
struct Outcome {
  FixedLag estimator;
  SolveStats last;
};
Outcome run(World world, const BackendOptions& options, double seconds, std::mt19937& rng,
            double moved_at = 1e9,
            const std::function<void(const FixedLag&, const SolveStats&)>& after_window = {}) {
  std::normal_distribution<double> normal;
  const auto random = [&](double sigma) { return Vec3(sigma * Vec3(normal(rng), normal(rng), normal(rng))); };
  Outcome outcome{FixedLag(world.rig, options), {}};
  FixedLag& estimator = outcome.estimator;
  NavState first = world.motion.state(0);
  const Vec3 tilt = random(0.05);
  first.T_w_i.q = quat_exp(Vec3(tilt.x(), tilt.y(), 0)) * first.T_w_i.q;
  first.v_w += random(std::min(0.5, options.start_velocity_sigma));
  first.bias.gyro = world.bias.gyro + random(options.gyro_bias_sigma);
  first.bias.accel = world.bias.accel + random(options.accel_bias_sigma);
  estimator.start(first, options.start_velocity_sigma < 1);
  auto samples =
      world.motion.readings(-0.1, seconds + 0.1, world.rig.imu.rate_hz, world.bias, &world.rig.imu, rng());
  for (ImuSample& sample : samples) {
    sample.gyro = world.gyro_scale * sample.gyro;
    sample.accel = world.accel_scale * sample.accel;
  }
  for (int w = 0; w < static_cast<int>(std::lround(seconds / kWindow)); ++w) {
    const double begin = w * kWindow;
    if (begin > moved_at) {
      for (LineEnds& line : world.lines) line.a += kMove, line.b += kMove;
      moved_at = 1e9;
    }
    WindowMeasurement window;
    window.imu = integrate(samples, begin, estimator.latest().bias, world.rig.imu);
    const auto middle = [&](int k) { return begin + (k + 0.5) * kWindow / kBins; };
    for (int k = 0; k < kBins; ++k) window.bin_motions.push_back(window.imu->at(from_seconds(middle(k))));
    for (std::size_t id = 0; id < world.lines.size(); ++id) {
      LineObservation seen;
      seen.id = static_cast<LineId>(id);
      for (int k = 0; k < kBins; ++k)
        if (auto bin = world.see(world.lines[id], middle(k) + kTimeShift, rng)) {
          bin->slot = k;
          seen.bins.push_back(*bin);
        }
      if (seen.bins.size() < kBins) continue;
      const auto motion = window.bin_motions[kBins / 2];
      seen.end_a = {seen.bins[kBins / 2].a_px, motion};
      seen.end_b = {seen.bins[kBins / 2].b_px, motion};
      window.lines.push_back(std::move(seen));
    }
    estimator.add(std::move(window));
    outcome.last = estimator.solve();
    if (after_window) after_window(estimator, outcome.last);
  }
  return outcome;
}

TEST(Consistency, TheCovarianceIsHonest) {
  constexpr int kRuns = 20, kPart = 9;  // position, rotation, velocity
  constexpr double kSeconds = 2.0;
  double sum = 0;
  for (int k = 0; k < kRuns; ++k) {
    std::mt19937 rng(static_cast<unsigned>(k));
    const World world(rng);
    const FixedLag estimator = run(world, honest_options(), kSeconds, rng).estimator;
    ASSERT_TRUE(estimator.covariance().has_value());
    ASSERT_GT(estimator.line_count(), 8U);
    const NavState &now = estimator.latest(), truth = world.motion.state(kSeconds);
    Eigen::Matrix<double, kPart, 1> error;
    error << now.T_w_i.p - truth.T_w_i.p, quat_log(truth.T_w_i.q.conjugate() * now.T_w_i.q),
        now.v_w - truth.v_w;
    const Eigen::Matrix<double, kPart, kPart> covariance =
        estimator.covariance()->topLeftCorner<kPart, kPart>();
    EXPECT_LT(error.head<3>().norm(), 0.1);
    sum += error.dot(covariance.ldlt().solve(error));
  }
  // Chi-square of 180 degrees of freedom, over 20: 99.9 % lie in here.
  EXPECT_GT(sum / kRuns, 6.2);
  EXPECT_LT(sum / kRuns, 12.4);
}

// Nothing but zero velocity and turning is known at rest: the gyro's bias follows, about the vertical too,
// and the heading does not drift away.
TEST(Consistency, ALongRestTellsTheBiasOfTheGyro) {
  constexpr double kSeconds = 15, kRate = 500;
  const Vec3 bias(0.006, -0.006, 0.006);
  Rig rig;
  rig.camera = {240, 180, 200, 200, 120, 90};
  rig.imu.rate_hz = kRate;
  std::mt19937 rng(8);
  std::normal_distribution<double> normal;
  const auto noise = [&](double density) {
    return Vec3(density * std::sqrt(kRate) * Vec3(normal(rng), normal(rng), normal(rng)));
  };
  std::vector<ImuSample> samples;
  for (int k = 0; k <= static_cast<int>((kSeconds + 0.2) * kRate); ++k)
    samples.push_back({.t = from_seconds(k / kRate - 0.1),
                       .accel = Vec3(0, 0, BackendOptions{}.gravity) + noise(rig.imu.accel_density),
                       .gyro = bias + noise(rig.imu.gyro_density)});
  FixedLag estimator(rig, honest_options());
  estimator.start({}, true);
  for (int w = 0; w < static_cast<int>(std::lround(kSeconds / kWindow)); ++w) {
    WindowMeasurement window;
    window.still = true;
    window.imu = integrate(samples, w * kWindow, estimator.latest().bias, rig.imu);
    estimator.add(std::move(window));
    estimator.solve();
  }
  const NavState& now = estimator.latest();
  EXPECT_LT((now.bias.gyro - bias).norm(), 1.5e-3);
  EXPECT_LT(quat_log(now.T_w_i.q).norm(), 0.02);  // the bias alone would turn it by 0.16 rad
  EXPECT_LT(now.T_w_i.p.norm(), 0.02);
}

// Known lines that all contradict the state mean that it is lost; it goes on with a new map.
TEST(Consistency, LinesOutOfPlaceMeanLost) {
  std::mt19937 rng(6);
  const World world(rng);
  BackendOptions options = honest_options();
  options.lag_windows = 20;
  options.bin_cauchy_sigmas = 1;
  EXPECT_EQ(run(world, options, 3, rng).last.restarts, 0);
  const Outcome moved = run(world, options, 3, rng, 1);
  EXPECT_EQ(moved.last.restarts, 1);
  EXPECT_GT(moved.estimator.line_count(), 8U);
  EXPECT_LT((moved.estimator.latest().v_w - world.motion.state(3).v_w).norm(), 0.15);
}

// Position and yaw of everything can be chosen freely: the measurements must not add information about them,
// however many windows have gone into the prior at different linearisation points.
TEST(Consistency, UnobservableDirectionsStayUnknown) {
  double mean = 0;  // of what is known of the yaw, in what was given
  for (const unsigned seed : {5U, 6U, 7U, 8U, 9U}) {
    SCOPED_TRACE(seed);
    std::mt19937 rng(seed);
    const World world(rng);
    BackendOptions options = honest_options();
    options.start_pose_sigma = 0.3;
    // A known velocity would say something about the yaw.
    options.start_velocity_sigma = options.moving_velocity_sigma = 10;
    FixedLag estimator = run(world, options, 2.5, rng).estimator;
    for (int k = 0; k < 3; ++k) estimator.solve();  // until the covariance is of the very state we ask for
    ASSERT_GT(estimator.line_count(), 8U);
    const StateMat information = estimator.covariance()->ldlt().solve(StateMat::Identity());
    const NavState& now = estimator.latest();
    const double given = 1 / (options.start_pose_sigma * options.start_pose_sigma);
    for (int axis = 0; axis < 3; ++axis) {
      StateVec shift = StateVec::Zero();
      shift[axis] = 1;
      EXPECT_LT(shift.dot(information * shift), 1.1 * given) << "position " << axis;
    }
    StateVec yaw = StateVec::Zero();
    yaw.head<3>() = Vec3::UnitZ().cross(now.T_w_i.p - world.motion.state(0).T_w_i.p);
    yaw.segment<3>(3) = now.T_w_i.q.conjugate() * Vec3::UnitZ();
    yaw.segment<3>(6) = Vec3::UnitZ().cross(now.v_w);
    const double known = yaw.dot(information * yaw) / given;
    EXPECT_LT(known, 1.1);
    mean += known / 5;
  }
  EXPECT_LT(mean, 1.06);
}

// Scale errors and misaligned axes of an uncalibrated unit: estimated, they cost little; taken for noise,
// much.
TEST(Consistency, EstimatesTheIntrinsicsOfTheImu) {
  constexpr double kSeconds = 8;
  std::mt19937 rng(12);
  World world(rng);
  world.gyro_scale << 1.01, 0.008, -0.006, -0.007, 0.99, 0.005, 0.008, -0.004, 1.008;
  world.accel_scale << 0.99, 0, 0, 0.008, 1.01, 0, -0.007, 0.006, 0.992;
  BackendOptions options = honest_options();
  const auto error = [&](bool refine) {
    options.refine_imu = refine;
    std::mt19937 noise(13);
    double worst = 0;
    const Outcome outcome =
        run(world, options, kSeconds, noise, 1e9, [&](const FixedLag& estimator, const SolveStats&) {
          const double t = static_cast<double>(estimator.latest().t) / kNsPerS;
          if (t > 0.5 * kSeconds)
            worst = std::max(worst, (estimator.latest().v_w - world.motion.state(t).v_w).norm());
        });
    EXPECT_EQ(outcome.last.restarts, 0);
    return worst;
  };
  const double with = error(true), without = error(false);
  EXPECT_LT(with, 0.05);
  EXPECT_LT(2 * with, without);
}

// A prior in square-root form cannot lose its sign, however many windows go into it and however large the
// ratio of what they know best to what they know least.
TEST(Consistency, ThousandsOfWindowsLeaveAPriorWithoutNegativeEigenvalues) {
  std::mt19937 rng(11);
  World world(rng);
  world.lines.resize(130);
  BackendOptions options = honest_options();
  options.lag_windows = 4;
  options.max_resting_lines = 5;
  options.start_pose_sigma = 0.3;
#ifdef __SANITIZE_ADDRESS__
  constexpr double kSeconds = 10;  // what takes seconds takes minutes there
#else
  constexpr double kSeconds = 110;
#endif
  int windows = 0;
  const Outcome outcome =
      run(world, options, kSeconds, rng, 1e9, [&](const FixedLag& estimator, const SolveStats& stats) {
        ASSERT_GE(stats.cost, 0);
        ASSERT_EQ(stats.restarts, 0);
        if (++windows % 100 != 0) return;
        const Eigen::MatrixXd& R = estimator.prior().rows().A;
        ASSERT_TRUE(R.allFinite());
        ASSERT_TRUE(R.isUpperTriangular(0));
        const Eigen::VectorXd eigenvalues =
            Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(R.transpose() * R, Eigen::EigenvaluesOnly)
                .eigenvalues();
        EXPECT_GT(eigenvalues.minCoeff(), -1e-15 * eigenvalues.maxCoeff());
        // Shifting the state and all lines together costs what the start says, and nothing else.
        for (int axis = 0; axis < 3; ++axis) {
          Eigen::VectorXd shift = Eigen::VectorXd::Zero(R.cols());
          shift[estimator.prior().state_column() + axis] = 1;
          for (std::size_t k = 0; k < estimator.prior().lines().size(); ++k) {
            const auto& [id, at] = estimator.prior().lines()[k];
            AnchoredLine line = estimator.line(id);
            line.coordinates = at;
            shift.segment<4>(MarginalPrior::line_column(k)) = line.world_moves().col(axis);
          }
          EXPECT_LT((R * shift).squaredNorm(), 1.01 / std::pow(options.start_pose_sigma, 2))
              << "window " << windows;
        }
      });
  EXPECT_EQ(windows, static_cast<int>(kSeconds / kWindow + 0.5));
  EXPECT_LT((outcome.estimator.latest().v_w - world.motion.state(kSeconds).v_w).norm(), 0.1);
}

}  // namespace
}  // namespace idol::test
