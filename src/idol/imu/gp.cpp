#include "idol/imu/gp.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>
#include <utility>

namespace idol {
namespace {

// First and second antiderivatives of exp(-x^2 / (2 l^2)) in x.
double kernel_integral(double x, double l) {
  return l * std::sqrt(std::numbers::pi / 2) * std::erf(x / (std::numbers::sqrt2 * l));
}
double kernel_double_integral(double x, double l) {
  return x * kernel_integral(x, l) + l * l * std::exp(-x * x / (2 * l * l));
}

}  // namespace

GaussianProcess::GaussianProcess(Eigen::VectorXd times, const Eigen::MatrixXd& values, double length_scale,
                                 double noise_ratio)
    : times_(std::move(times)), mean_(values.colwise().mean()), length_scale_(length_scale) {
  const Eigen::Index n = times_.size();
  Eigen::MatrixXd K(n, n);
  for (Eigen::Index j = 0; j < n; ++j)
    K.col(j) = (-(times_.array() - times_[j]).square() / (2 * length_scale * length_scale)).exp();
  // The kernel matrix alone is singular to working precision when l spans several samples.
  K.diagonal().array() += std::max(noise_ratio, 1e-9);
  weights_ = K.llt().solve(values.rowwise() - mean_.transpose());
}

Eigen::VectorXd GaussianProcess::value(double t) const {
  const Eigen::VectorXd k = (-(times_.array() - t).square() / (2 * length_scale_ * length_scale_)).exp();
  return mean_ + weights_.transpose() * k;
}

Eigen::VectorXd GaussianProcess::integral(double from, double t) const {
  const Eigen::VectorXd k = times_.unaryExpr([&](double s) {
    return kernel_integral(t - s, length_scale_) - kernel_integral(from - s, length_scale_);
  });
  return (t - from) * mean_ + weights_.transpose() * k;
}

Eigen::MatrixX2d GaussianProcess::integrals(double from, double t) const {
  const double dt = t - from;
  Eigen::MatrixX2d k(times_.size(), 2);
  for (Eigen::Index i = 0; i < times_.size(); ++i) {
    const double x0 = from - times_[i];
    const double x1 = t - times_[i];
    const double F0 = kernel_integral(x0, length_scale_);
    k(i, 0) = kernel_integral(x1, length_scale_) - F0;
    k(i, 1) = kernel_double_integral(x1, length_scale_) - kernel_double_integral(x0, length_scale_) - F0 * dt;
  }
  Eigen::MatrixX2d out = weights_.transpose() * k;
  out.col(0) += dt * mean_;
  out.col(1) += 0.5 * dt * dt * mean_;
  return out;
}

}  // namespace idol
