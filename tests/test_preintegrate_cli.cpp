// The command-line contract of `idol preintegrate`.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <sstream>

#include "idol/imu/preintegration.hpp"
#include "imu_motion.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::run_idol;
using test::SineMotion;

constexpr double kEpoch = 1500000000.25;  // stamps are absolute

std::string imu_text(const std::vector<ImuSample>& samples) {
  std::string text;
  for (const auto& s : samples)
    text += fmt::format("{}.{:09} {:.15g} {:.15g} {:.15g} {:.15g} {:.15g} {:.15g}\n", s.t / 1'000'000'000,
                        s.t % 1'000'000'000, s.accel.x(), s.accel.y(), s.accel.z(), s.gyro.x(), s.gyro.y(), s.gyro.z());
  return text;
}

std::vector<ImuSample> recording(const SineMotion& motion, const ImuBias& bias = {}) {
  auto samples = motion.readings(0, 2, 200, bias);
  for (auto& s : samples) s.t += from_seconds(kEpoch);
  return samples;
}

std::vector<std::vector<double>> rows_of(const std::string& text) {
  std::vector<std::vector<double>> rows;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream columns(line);
    rows.emplace_back();
    for (double value; columns >> value;) rows.back().push_back(value);
  }
  return rows;
}

struct Files {
  test::TempDir dir;
  std::string imu, at;
  explicit Files(const std::vector<double>& times, const ImuBias& bias = {}) {
    imu = dir.write("imu.txt", imu_text(recording(SineMotion{3.0}, bias))).string();
    std::string text;
    for (double t : times) text += fmt::format("{:.6f}\n", kEpoch + t);
    at = dir.write("times.txt", text).string();
  }
  [[nodiscard]] test::CommandResult run(const std::string& more = "", double from = 0.5) const {
    return run_idol(fmt::format("preintegrate --imu {} --from {:.6f} --at {} {}", imu, kEpoch + from, at, more));
  }
};

TEST(PreintegrateCommand, PrintsTheTrueMotionForEachTimeInTheFilesOrder) {
  const ImuBias bias{Vec3(0.01, -0.02, 0.03), Vec3(-0.1, 0.2, 0.3)};
  const std::vector<double> times = {0.5, 1.25, 0.7003, 0.3};
  const Files files(times, bias);
  const SineMotion motion{3.0};
  const NavState a = motion.state(0.5);
  for (const char* method : {"", "--method continuous", "--method gpm", "--method lpm"}) {
    const auto result = files.run(std::string("--gyro-bias 0.01,-0.02,0.03 --accel-bias -0.1,0.2,0.3 ") + method);
    ASSERT_EQ(result.status, 0) << result.err;
    const auto rows = rows_of(result.out);
    ASSERT_EQ(rows.size(), times.size());
    const double tolerance = std::string(method) == "--method lpm" ? 1e-2 : 5e-5;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const NavState b = motion.state(times[i]);
      const double dt = times[i] - 0.5;
      const Vec3 g = motion.gravity;
      const Quat inverse = a.T_w_i.q.conjugate();
      ASSERT_EQ(rows[i].size(), 11u);
      EXPECT_NEAR(rows[i][0], kEpoch + times[i], 1e-6);
      const Quat q(rows[i][4], rows[i][1], rows[i][2], rows[i][3]);
      EXPECT_NEAR(q.norm(), 1, 1e-11);
      EXPECT_LT(quat_log(q.conjugate() * inverse * b.T_w_i.q).norm(), tolerance) << method;
      const Vec3 v(rows[i][5], rows[i][6], rows[i][7]), p(rows[i][8], rows[i][9], rows[i][10]);
      EXPECT_LT((v - inverse * (b.v_w - a.v_w - g * dt)).norm(), tolerance) << method;
      EXPECT_LT((p - inverse * (b.T_w_i.p - a.T_w_i.p - a.v_w * dt - 0.5 * dt * dt * g)).norm(), tolerance) << method;
    }
  }
}

TEST(PreintegrateCommand, AppendsTheCovarianceInTheOrderRotationVelocityPosition) {
  const Files files({1.25, 0.3});
  const auto rig = files.dir.write("imu.yaml",
                                   "gyroscope_noise_density: 0.001\ngyroscope_random_walk: 1e-5\n"
                                   "accelerometer_noise_density: 0.01\naccelerometer_random_walk: 1e-4\nupdate_rate: 200\n");
  const auto result = files.run("--covariance --imu-rig " + rig.string());
  ASSERT_EQ(result.status, 0) << result.err;
  const auto rows = rows_of(result.out);
  ASSERT_EQ(rows.size(), 2u);
  for (const auto& row : rows) {
    ASSERT_EQ(row.size(), 11u + 45u);
    Mat9 S;
    std::size_t k = 11;
    for (int i = 0; i < 9; ++i)
      for (int j = i; j < 9; ++j) S(i, j) = S(j, i) = row[k++];
    EXPECT_GT(S.llt().matrixLLT().diagonal().minCoeff(), 0);
    const double span = std::abs(row[0] - (kEpoch + 0.5));
    EXPECT_NEAR(std::sqrt(S(0, 0)), 0.001 * std::sqrt(span), 0.03 * 0.001 * std::sqrt(span));
    EXPECT_GT(S(4, 4), 1e-4 * span * 0.97);
    EXPECT_GT(S(7, 7), 1e-4 * span * span * span / 3 * 0.9);
    EXPECT_LT(S(7, 7), S(4, 4));
  }
}

TEST(PreintegrateCommand, EndsAtATimeOutsideTheDataAfterTheRowsBeforeIt) {
  const auto result = Files({0.6, 0.7, 2.5, 0.8}).run();
  EXPECT_EQ(result.status, 1);
  EXPECT_EQ(rows_of(result.out).size(), 2u);
  EXPECT_NE(result.err.find("outside the data"), std::string::npos) << result.err;
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
}

TEST(PreintegrateCommand, TellsBadDataFromWrongUsage) {
  const Files files({0.6});
  EXPECT_EQ(files.run("", 5.0).status, 1);
  EXPECT_EQ(files.run("--method spline").status, 2);
  EXPECT_EQ(files.run("--gyro-bias 1,2").status, 2);
  EXPECT_EQ(files.run("--nonsense").status, 2);
  EXPECT_EQ(run_idol("preintegrate --imu " + files.imu + " --at " + files.at).status, 2);
  EXPECT_EQ(run_idol("preintegrate --imu " + files.imu + " --from soon --at " + files.at).status, 2);
  EXPECT_EQ(files.run("--imu-rig /no/such/file").status, 1);
  const auto at = [&](const std::string& text) {
    const auto file = files.dir.write("at.txt", text).string();
    return run_idol(fmt::format("preintegrate --imu {} --from {} --at {}", files.imu, kEpoch + 0.5, file));
  };
  EXPECT_EQ(at("").status, 1);
  EXPECT_EQ(at("1500000001\nnan\n").status, 1);
  EXPECT_EQ(at("1500000001 2\n").status, 1);
  const auto imu = [&](const std::string& text) {
    const auto file = files.dir.write("bad_imu.txt", text).string();
    return run_idol(fmt::format("preintegrate --imu {} --from 1 --at {}", file, files.at));
  };
  for (const char* text : {"", "1 0 0 9.8 0 0 0\n", "1 0 0 9.8 0 0\n2 0 0 9.8 0 0\n", "a b c\n"}) {
    const auto result = imu(text);
    EXPECT_EQ(result.status, 1) << text;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  }
}

TEST(PreintegrateCommand, WarnsOfGaps) {
  auto samples = recording(SineMotion{1.0});
  std::erase_if(samples, [](const ImuSample& s) {
    const double t = seconds_between(from_seconds(kEpoch), s.t);
    return t > 0.8 && t < 1.1;
  });
  const Files files({1.5});
  const auto imu = files.dir.write("gap.txt", imu_text(samples));
  const auto result = run_idol(fmt::format("preintegrate --imu {} --from {} --at {}", imu.string(), kEpoch + 0.5, files.at));
  EXPECT_EQ(result.status, 0);
  EXPECT_NE(result.err.find("no data for up to 0.3"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace idol
