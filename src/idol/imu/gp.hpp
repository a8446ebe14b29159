// Gaussian-process regression of sampled signals, and its analytic integrals (Le Gentil et al. 2020, sec. III;
// docs/paper.md). Squared-exponential kernel k(t, t') = exp(-(t - t')^2 / (2 l^2)), in units of the signal's variance.
#pragma once

#include <Eigen/Core>

namespace idol {

/// Several signals (columns) sampled at the same instants, seen as continuous functions of time [s].
/// The mean of each signal is taken off before the regression and added back, so constants are exact.
class GaussianProcess {
 public:
  /// `times` strictly increasing [s], `values` times.size() x channels. `length_scale` [s];
  /// `noise_ratio` = noise variance / signal variance of one sample.
  GaussianProcess(Eigen::VectorXd times, const Eigen::MatrixXd& values, double length_scale, double noise_ratio);

  /// Values at `t`: one entry a channel.
  [[nodiscard]] Eigen::VectorXd value(double t) const;
  /// Integral from `from` to `t`.
  [[nodiscard]] Eigen::VectorXd integral(double from, double t) const;
  /// Integral and iterated integral (of the integral) from `from` to `t`, as two columns.
  [[nodiscard]] Eigen::MatrixX2d integrals(double from, double t) const;

 private:
  Eigen::VectorXd times_;
  Eigen::VectorXd mean_;      // one a channel
  Eigen::MatrixXd weights_;   // (K + r I)^-1 (values - mean), samples x channels
  double length_scale_;
};

}  // namespace idol
