#include "idol/imu/interval_fit.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <tuple>
#include <utility>

#include "idol/imu/gp.hpp"

namespace idol {
namespace {

constexpr std::size_t kGpSamples = kMostFitSamples;

// The samples around interval k of `count` intervals + 1: as many on both sides as there are, `wanted` in
// all.
std::pair<std::size_t, std::size_t> neighbours(std::size_t k, std::size_t samples, std::size_t wanted) {
  const std::size_t count = std::min(wanted, samples);
  const std::size_t before = count / 2 - 1;
  const std::size_t first = std::min(k > before ? k - before : 0, samples - count);
  return {first, count};
}

// Coefficients of the polynomial with given values at eight points spread over [0, 1] (Chebyshev).
struct PolynomialBasis {
  Eigen::Matrix<double, kFitCoefficients, 1> points;
  Eigen::Matrix<double, kFitCoefficients, kFitCoefficients> from_values;

  PolynomialBasis() {
    Eigen::Matrix<double, kFitCoefficients, kFitCoefficients> powers;
    for (int i = 0; i < kFitCoefficients; ++i) {
      points[i] = 0.5 - 0.5 * std::cos((i + 0.5) * std::numbers::pi / kFitCoefficients);
      for (int j = 0; j < kFitCoefficients; ++j) powers(i, j) = std::pow(points[i], j);
    }
    from_values = powers.inverse();
  }
};

// Weights of samples at `u` in the Gaussian process' mean over [0, 1]; all in units of the interval.
FitWeights gp_weights(const Eigen::VectorXd& u, double length_scale, double noise_ratio) {
  static const PolynomialBasis basis;
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(u.size(), u.size());
  const GaussianProcess gp(u, unit, length_scale, noise_ratio);
  FitWeights values(kFitCoefficients, u.size());
  for (int i = 0; i < kFitCoefficients; ++i) values.row(i) = gp.value(basis.points[i]);
  return basis.from_values * values;
}

// On a regular grid the weights depend on the kernel alone: one set for each place of the interval among its
// samples.
std::shared_ptr<const std::vector<FitWeights>> regular_gp_weights(std::size_t samples, double length_scale,
                                                                  double noise_ratio) {
  using Key = std::tuple<std::size_t, double, double>;
  static std::mutex mutex;
  static std::map<Key, std::shared_ptr<const std::vector<FitWeights>>> known;
  const std::lock_guard lock(mutex);
  auto& entry = known[{samples, length_scale, noise_ratio}];
  if (!entry) {
    std::vector<FitWeights> all;
    for (std::size_t place = 0; place + 1 < samples; ++place) {
      const auto n = static_cast<double>(samples) - 1;
      const Eigen::VectorXd u = Eigen::VectorXd::LinSpaced(static_cast<Eigen::Index>(samples), 0, n).array() -
                                static_cast<double>(place);
      all.push_back(gp_weights(u, length_scale, noise_ratio));
    }
    entry = std::make_shared<const std::vector<FitWeights>>(std::move(all));
  }
  return entry;
}

// Windows share their weights only if their noise ratios are the same number: four steps a decade.
double rounded_ratio(double ratio) {
  return std::pow(10.0, 0.25 * std::round(4 * std::log10(std::clamp(ratio, 1e-9, 10.0))));
}

}  // namespace

IntervalFit::IntervalFit(std::span<const double> times, double period, const PreintegrationOptions& options,
                         double noise_ratio)
    : times_(times),
      period_(period),
      method_(options.method),
      length_scale_(options.length_scale_samples),
      noise_ratio_(rounded_ratio(noise_ratio)) {
  if (method_ == PreintegrationMethod::kGpm)
    shared_weights_ = regular_gp_weights(std::min(kGpSamples, times.size()), length_scale_, noise_ratio_);
}

FitPolynomial IntervalFit::operator()(std::size_t k, std::span<const Vec3> values) const {
  switch (method_) {
    case PreintegrationMethod::kGpm:
      return gaussian_process(k, values);
    case PreintegrationMethod::kLpm: {
      FitPolynomial line = FitPolynomial::Zero();
      line.row(0) = values[k];
      line.row(1) = values[k + 1] - values[k];
      return line;
    }
    case PreintegrationMethod::kContinuous:
      break;
  }
  return through_neighbours(k, values);
}

// Newton's divided differences, multiplied out.
FitPolynomial IntervalFit::through_neighbours(std::size_t k, std::span<const Vec3> values) const {
  const double length = times_[k + 1] - times_[k];
  auto [first, count] = neighbours(k, times_.size(), kFitCoefficients);
  // How long the interval is beside the others of its fit: a rate that changes is no hole.
  const double others = times_[first + count - 1] - times_[first] - length;
  const double ratio = count > 2 ? length * static_cast<double>(count - 2) / others : 1;
  if (ratio > 2.5) std::tie(first, count) = neighbours(k, times_.size(), ratio < 4.5 ? 4 : 2);
  std::array<double, kFitCoefficients> u;
  std::array<Vec3, kFitCoefficients> difference;
  for (std::size_t i = 0; i < count; ++i) {
    u[i] = (times_[first + i] - times_[k]) / length;
    difference[i] = values[first + i];
  }
  for (std::size_t order = 1; order < count; ++order)
    for (std::size_t i = count - 1; i >= order; --i)
      difference[i] = (difference[i] - difference[i - 1]) / (u[i] - u[i - order]);
  FitPolynomial out = FitPolynomial::Zero();
  out.row(0) = difference[count - 1];
  for (std::size_t i = count - 1; i-- > 0;) {
    for (auto j = static_cast<Eigen::Index>(count - 1 - i); j > 0; --j)
      out.row(j) = out.row(j - 1) - u[i] * out.row(j);
    out.row(0) = difference[i].transpose() - u[i] * out.row(0);
  }
  return out;
}

FitWeights IntervalFit::regular_weights() const {
  constexpr std::array<int, 3> kSamples = {kGpSamples, 2, kFitCoefficients};
  const int count = kSamples[static_cast<std::size_t>(method_)];
  PreintegrationOptions options;
  options.method = method_;
  options.length_scale_samples = length_scale_;
  std::vector<double> times(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) times[static_cast<std::size_t>(i)] = i;
  const IntervalFit fit(times, 1, options, noise_ratio_);
  FitWeights out(kFitCoefficients, count);
  for (int i = 0; i < count; ++i) {
    std::vector<Vec3> unit(times.size(), Vec3::Zero());
    unit[static_cast<std::size_t>(i)].x() = 1;
    out.col(i) = fit(times.size() / 2 - 1, unit).col(0);
  }
  return out;
}

bool IntervalFit::regular(std::size_t first, std::size_t count) const {
  // What stamps rounded to microseconds leave: a rate hardly changes in that time.
  const double tolerance = std::max(2.5e-6, 1e-3 * period_);
  for (std::size_t i = first; i + 1 < first + count; ++i)
    if (std::abs(times_[i + 1] - times_[i] - period_) > tolerance) return false;
  return true;
}

FitPolynomial IntervalFit::gaussian_process(std::size_t k, std::span<const Vec3> values) const {
  const auto [first, count] = neighbours(k, times_.size(), kGpSamples);
  const Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic>> samples(values[first].data(), 3,
                                                                           static_cast<Eigen::Index>(count));
  if (regular(first, count)) return (*shared_weights_)[k - first] * samples.transpose();
  const double length = times_[k + 1] - times_[k];
  Eigen::VectorXd u(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i)
    u[static_cast<Eigen::Index>(i)] = (times_[first + i] - times_[k]) / length;
  return gp_weights(u, length_scale_ * period_ / length, noise_ratio_) * samples.transpose();
}

}  // namespace idol
