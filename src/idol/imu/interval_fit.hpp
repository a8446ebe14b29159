// The inertial signals between two samples, as polynomials fitted to the samples around
// (docs/preintegration.md).
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "idol/base/lie.hpp"
#include "idol/imu/preintegration_options.hpp"

namespace idol {

/// Polynomials of degree 7 in u, which goes from 0 to 1 over an interval between two samples: one column an
/// axis, row i the coefficient of u^i.
constexpr int kFitCoefficients = 8;
using FitPolynomial = Eigen::Matrix<double, kFitCoefficients, 3>;

/// Weights of the samples around an interval in its polynomial's coefficients, 8 x samples.
using FitWeights = Eigen::Matrix<double, kFitCoefficients, Eigen::Dynamic>;

/// Most samples that shape one interval.
constexpr std::size_t kMostFitSamples = 24;

/// Fits each interval of a sampled signal, in time that does not depend on the number of samples.
/// - continuous: the polynomial through the eight samples around; fewer across holes, where a high degree
/// would swing.
/// - lpm: the straight line through the interval's own two.
/// - gpm: the posterior mean of a Gaussian process of the sixteen samples around. On a regular grid its
/// weights are
///   the same for every interval and window, and computed once in the program's life.
class IntervalFit {
 public:
  /// `times` [s] strictly increasing, at least two; kept by reference. `period` their usual distance. For
  /// gpm, `noise_ratio` = noise variance / signal variance of one sample.
  IntervalFit(std::span<const double> times, double period, const PreintegrationOptions& options,
              double noise_ratio = 0);

  /// The signal with these `values` at the times, between times[k] and times[k + 1].
  [[nodiscard]] FitPolynomial operator()(std::size_t k, std::span<const Vec3> values) const;

  /// The weights of the samples around an interval in the middle of a regular grid; an even number of
  /// samples.
  [[nodiscard]] FitWeights regular_weights() const;

 private:
  [[nodiscard]] FitPolynomial through_neighbours(std::size_t k, std::span<const Vec3> values) const;
  [[nodiscard]] FitPolynomial gaussian_process(std::size_t k, std::span<const Vec3> values) const;
  [[nodiscard]] bool regular(std::size_t first, std::size_t count) const;

  std::span<const double> times_;
  double period_;
  PreintegrationMethod method_;
  double length_scale_;  // of the Gaussian process, in periods
  double noise_ratio_;
  std::shared_ptr<const std::vector<FitWeights>>
      shared_weights_;  // by the place of the interval among its samples
};

}  // namespace idol
