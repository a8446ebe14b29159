// Textbook preintegrations to compare with, from one sample to another: no queries in between, no noise
// propagation.
#pragma once

#include <span>

#include "idol/imu/gp.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol::bench {

/// On the manifold with the readings constant over each interval (Forster et al. 2017, eq. 33), with the bias
/// Jacobians and the covariance of their recursions (appendix), as is usual in estimators.
struct ForsterResult : Motion {
  Mat3 d_R_d_bg = Mat3::Zero(), d_v_d_bg = Mat3::Zero(), d_v_d_ba = Mat3::Zero(), d_p_d_bg = Mat3::Zero(),
       d_p_d_ba = Mat3::Zero();
  Mat9 covariance = Mat9::Zero();
};

/// `midpoint`: with the mean of the readings at both ends of an interval instead of the first.
inline ForsterResult forster(std::span<const ImuSample> samples, double gyro_density, double accel_density,
                             bool midpoint) {
  ForsterResult m;
  for (std::size_t k = 0; k + 1 < samples.size(); ++k) {
    const double h = seconds_between(samples[k].t, samples[k + 1].t);
    const Vec3 w = midpoint ? Vec3(0.5 * (samples[k].gyro + samples[k + 1].gyro)) : samples[k].gyro;
    const Mat3 E = so3_exp(h * w), Jr = right_jacobian(h * w);
    const Vec3 f = midpoint ? Vec3(0.5 * (samples[k].accel + E * samples[k + 1].accel)) : samples[k].accel;
    const Mat3 Rf = m.dR * hat(f);
    Mat9 A = Mat9::Identity();  // of (rotation, velocity, position)
    A.block<3, 3>(0, 0) = E.transpose();
    A.block<3, 3>(3, 0) = -h * Rf;
    A.block<3, 3>(6, 0) = -0.5 * h * h * Rf;
    A.block<3, 3>(6, 3) = h * Mat3::Identity();
    Eigen::Matrix<double, 9, 6> B = Eigen::Matrix<double, 9, 6>::Zero();
    B.block<3, 3>(0, 0) = h * Jr;
    B.block<3, 3>(3, 3) = h * m.dR;
    B.block<3, 3>(6, 3) = 0.5 * h * h * m.dR;
    Eigen::Matrix<double, 6, 1> variance;
    variance << Vec3::Constant(gyro_density * gyro_density / h),
        Vec3::Constant(accel_density * accel_density / h);
    m.covariance = A * m.covariance * A.transpose() + B * variance.asDiagonal() * B.transpose();
    m.d_p_d_ba += h * m.d_v_d_ba - 0.5 * h * h * m.dR;
    m.d_p_d_bg += h * m.d_v_d_bg - 0.5 * h * h * Rf * m.d_R_d_bg;
    m.d_v_d_ba -= h * m.dR;
    m.d_v_d_bg -= h * Rf * m.d_R_d_bg;
    m.d_R_d_bg = E.transpose() * m.d_R_d_bg - h * Jr;
    m.dp += h * m.dv + 0.5 * h * h * (m.dR * f);
    m.dv += h * (m.dR * f);
    m.dR = m.dR * E;
    m.dt += h;
  }
  return m;
}

/// The paper's model as published (III-B): dense Gaussian processes over all samples, the rotation by a
/// product of exponentials on a grid `grid` times as fine, velocity and position by the kernel's integrals.
/// The motion from sample `first` to sample `last`.
inline Motion dense_gpm(std::span<const ImuSample> samples, std::size_t first, std::size_t last,
                        double gyro_ratio, double accel_ratio, int grid = 10) {
  const auto n = std::ssize(samples);
  Eigen::VectorXd times(n);
  Eigen::MatrixXd rates(n, 3), forces(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    times[i] = seconds_between(samples[first].t, samples[static_cast<std::size_t>(i)].t);
    rates.row(i) = samples[static_cast<std::size_t>(i)].gyro;
  }
  const double period = (times[n - 1] - times[0]) / static_cast<double>(n - 1);
  const GaussianProcess gyro(times, rates, 3 * period, gyro_ratio);
  std::vector<Mat3> R(samples.size(), Mat3::Identity());
  const auto step = [&](std::size_t k) {
    Mat3 E = Mat3::Identity();
    const auto i = static_cast<Eigen::Index>(k);
    const double h = (times[i + 1] - times[i]) / grid;
    for (int j = 0; j < grid; ++j) E = E * so3_exp(h * Vec3(gyro.value(times[i] + (j + 0.5) * h)));
    return E;
  };
  for (std::size_t k = first; k + 1 < samples.size(); ++k) R[k + 1] = R[k] * step(k);
  for (std::size_t k = first; k-- > 0;) R[k] = R[k + 1] * step(k).transpose();
  for (Eigen::Index i = 0; i < n; ++i)
    forces.row(i) = R[static_cast<std::size_t>(i)] * samples[static_cast<std::size_t>(i)].accel;
  const GaussianProcess accel(times, forces, 3 * period, accel_ratio);
  Motion out;
  out.dt = times[static_cast<Eigen::Index>(last)];
  out.dR = R[last];
  const Eigen::MatrixX2d integrals = accel.integrals(0, out.dt);
  out.dv = integrals.col(0);
  out.dp = integrals.col(1);
  return out;
}

}  // namespace idol::bench
