#include "idol/imu/imu_init.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

// Spread (RMS over the axes) of means over short blocks: motion, not sensor noise.
double block_spread(std::span<const ImuSample> samples, Vec3 ImuSample::*field) {
  constexpr double kBlock = 0.025;
  std::vector<Vec3> means;
  Vec3 sum = Vec3::Zero();
  int count = 0;
  Time block_begin = samples.front().t;
  for (const auto& sample : samples) {
    if (seconds_between(block_begin, sample.t) >= kBlock && count > 0) {
      means.push_back(sum / count);
      sum.setZero();
      count = 0;
      block_begin = sample.t;
    }
    sum += sample.*field;
    ++count;
  }
  if (means.size() < 2) return 0;
  Vec3 mean = Vec3::Zero();
  for (const auto& m : means) mean += m / static_cast<double>(means.size());
  double variance = 0;
  for (const auto& m : means) variance += (m - mean).squaredNorm() / static_cast<double>(3 * means.size());
  return std::sqrt(variance);
}

}  // namespace

ImuInit initialise_from_imu(std::span<const ImuSample> samples, double gravity,
                            const ImuInitOptions& options) {
  if (samples.size() < 10)
    throw DataError(fmt::format("only {} IMU samples at the start: too few to find gravity", samples.size()));
  ImuInit init;
  init.gyro_std = block_spread(samples, &ImuSample::gyro);
  init.accel_std = block_spread(samples, &ImuSample::accel);
  init.still = init.gyro_std < options.still_gyro_std && init.accel_std < options.still_accel_std;
  if (init.still)
    for (const auto& sample : samples) init.bias.gyro += sample.gyro / static_cast<double>(samples.size());

  Quat q_first_now = Quat::Identity();
  Vec3 force = Vec3::Zero();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (i > 0) {
      const double dt = seconds_between(samples[i - 1].t, samples[i].t);
      const Vec3 rate = 0.5 * (samples[i - 1].gyro + samples[i].gyro) - init.bias.gyro;
      q_first_now = (q_first_now * quat_exp(rate * dt)).normalized();
    }
    force += q_first_now * samples[i].accel / static_cast<double>(samples.size());
  }
  // Nobody falls, or is thrown with three times gravity, for most of a second.
  constexpr double kViolent = 0.3, kImpossible = 3;
  const double share = force.norm() / gravity;
  const auto reads = fmt::format("the accelerometer reads {:.2f} m/s^2 on average at the start, not {:.2f}",
                                 force.norm(), gravity);
  if (share > kImpossible || share < 1 / kImpossible)
    throw DataError(reads + ": wrong units or wrong columns");
  if (std::abs(share - 1) > kViolent)
    throw ViolentStart(reads + ": wrong units, wrong columns, or a violent start");
  const Vec3 up = force.normalized();
  const Vec3 ahead = std::abs(up.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  Mat3 R_i_w;
  R_i_w.col(2) = up;
  R_i_w.col(0) = (ahead - up * up.dot(ahead)).normalized();
  R_i_w.col(1) = up.cross(R_i_w.col(0));
  init.q_w_i = Quat(R_i_w.transpose()).normalized();
  return init;
}

}  // namespace idol
