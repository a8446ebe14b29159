// Covariance of a preintegrated motion. Each sample's noise enters with the weight that its signal's fit
// gives it in the integral; a sample is done with once the integral has left all fits it takes part in.
// Errors of rotation are taken on the left of dR, where they only add up: R_true = Exp(eta) R; the errors of
// velocity grow by -hat(a) eta and the turned noise of the accelerometer, those of position by those of
// velocity.
#include <algorithm>
#include <utility>

#include "idol/imu/preintegration.hpp"

namespace idol {
namespace {

Mat3 cross(const Vec3& a, const Mat3& B) {
  Mat3 out;
  for (int i = 0; i < 3; ++i) out.col(i) = a.cross(B.col(i));
  return out;
}
// B hat(a)^T.
Mat3 cross_right(const Mat3& B, const Vec3& a) { return cross(a, B.transpose()).transpose(); }

// Turns a diagonal covariance; one that looks the same from all sides needs no turning.
Mat3 turned(const Mat3& R, const Vec3& variance) {
  if (variance.x() == variance.y() && variance.y() == variance.z()) return variance.x() * Mat3::Identity();
  return R * variance.asDiagonal() * R.transpose();
}

}  // namespace

// Errors at one time carried to another, when the velocity has grown by dv and the position by dp beyond h
// times it.
void Preintegration::ErrorBlocks::carry(const Vec3& dv, const Vec3& dp, double h) {
  const Mat3 RV = VR.transpose(), RP = PR.transpose();
  const Mat3 new_vr = VR - cross(dv, RR);
  const Mat3 new_pr = PR + h * VR - cross(dp, RR);
  const Mat3 half_new_pv = PV + h * VV - cross(dp, RV);  // new position, old velocity
  PP += h * PV.transpose() - cross(dp, RP) + h * half_new_pv - cross_right(new_pr, dp);
  PV = half_new_pv - cross_right(new_pr, dv);
  VV -= cross(dv, RV) + cross_right(new_vr, dv);
  VR = new_vr;
  PR = new_pr;
}

// Noise of the covariances gyro and accel (in the frame of the window's begin): turns by c, bends velocity
// and position by x and y, and moves them by c and cp.
void Preintegration::ErrorBlocks::add(const Mat3& gyro, const Mat3& accel, double c, double cp, const Vec3& x,
                                      const Vec3& y) {
  const Mat3 XG = cross(x, gyro), YG = cross(y, gyro);
  RR += c * c * gyro;
  VR -= c * XG;
  PR -= c * YG;
  VV += cross_right(XG, x) + c * c * accel;
  PV += cross_right(YG, x) + c * cp * accel;
  PP += cross_right(YG, y) + cp * cp * accel;
}

// Weights on a regular grid, also for one that is not: how a covariance is spread among neighbours matters
// little.
void Preintegration::build_covariance(PreparedSamples& samples, const FitWeights& weights) {
  gap_ = std::move(samples.gap);
  gyro_variance_ = std::move(samples.gyro_variance);
  accel_variance_ = std::move(samples.accel_variance);
  usual_length_ = samples.period;
  weights_ = weights;
  linear_weights_ = FitWeights::Zero(kFitCoefficients, weights.cols());
  const Eigen::Index own = weights.cols() / 2 - 1;
  linear_weights_(0, own) = 1;
  linear_weights_(1, own) = -1;
  linear_weights_(1, own + 1) = 1;
  Errors errors;
  for (std::size_t k = first_interval_; k < intervals_.size(); ++k) {
    if ((k - first_interval_) % kErrorStride == 0) errors_.push_back(errors);
    if (k + 1 < intervals_.size()) advance_errors(k, errors);
  }
}

// Shares of the samples around interval k in the integral over it, from its begin (or the window's) to u.
void Preintegration::add_shares(std::size_t k, double u, std::array<Share, kMostFitSamples>& shares) const {
  const Interval& interval = intervals_[k];
  const double h = interval.length;
  const double u0 = k == first_interval_ ? -interval.s * interval.per_length : 0;
  Eigen::Matrix<double, kFitCoefficients, 2> integrals;  // of u^i and u^(i+1)
  double upper = u, lower = u0;
  for (int i = 0; i < kFitCoefficients; ++i) {
    integrals(i, 0) = (upper - lower) / (i + 1);
    upper *= u;
    lower *= u0;
    integrals(i, 1) = (upper - lower) / (i + 2);
  }
  const FitWeights& weights = h < 2.5 * usual_length_ ? weights_ : linear_weights_;
  const auto before = static_cast<std::ptrdiff_t>(weights.cols() / 2 - 1);
  for (Eigen::Index i = 0; i < weights.cols(); ++i) {
    const double sum = h * weights.col(i).dot(integrals.col(0));
    const double moment = h * h * weights.col(i).dot(integrals.col(1));
    const double since = interval.s - intervals_[sample(static_cast<std::ptrdiff_t>(k) - before + i)].s;
    shares[static_cast<std::size_t>(i)].weight += sum;
    shares[static_cast<std::size_t>(i)].moment += moment + since * sum;
  }
}

// The interval that begins with a sample; beyond the data's ends, the nearest.
std::size_t Preintegration::sample(std::ptrdiff_t i) const {
  return static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, std::ssize(intervals_) - 1));
}

// The noise of one sample, as seen from `here`.
void Preintegration::add_sample(ErrorBlocks& errors, std::ptrdiff_t i, const Share& share,
                                const Motion& here) const {
  const std::size_t k = sample(i);
  const Interval& at = intervals_[k];
  const Vec3 a = at.accel.row(0);
  const double lag = here.dt - at.s;
  errors.add(turned(at.R, gyro_variance_[k]), turned(at.R, accel_variance_[k]), share.weight,
             share.weight * lag - share.moment, share.weight * (here.dv - at.v) - share.moment * a,
             share.weight * (here.dp - at.p - lag * at.v) - lag * share.moment * a);
}

// From the begin of interval k to its end.
void Preintegration::advance_errors(std::size_t k, Errors& errors) const {
  const Interval &from = intervals_[k], &to = intervals_[k + 1];
  if (k > first_interval_)
    errors.done.carry(to.v - from.v, to.p - from.p - from.length * from.v, from.length);
  add_shares(k, 1, errors.shares);
  Motion here;
  here.dt = to.s;
  here.dv = to.v;
  here.dp = to.p;
  add_sample(errors.done, static_cast<std::ptrdiff_t>(k) - weights_.cols() / 2 + 1, errors.shares[0], here);
  std::shift_left(errors.shares.begin(), errors.shares.begin() + weights_.cols(), 1);
  errors.shares[static_cast<std::size_t>(weights_.cols()) - 1] = {};
  if (gap_[k]) add_gap(errors.done, k, to.s);
}

// A rate and an acceleration that stay unknown for as long as the gap is.
void Preintegration::add_gap(ErrorBlocks& errors, std::size_t k, double s) const {
  const double tau = s - std::max(intervals_[k].s, 0.0);
  const Vec3 a = intervals_[k].accel.row(0);
  errors.add(std::pow(options_.gap_gyro_sigma, 2) * Mat3::Identity(),
             std::pow(options_.gap_accel_sigma, 2) * Mat3::Identity(), tau, 0.5 * tau * tau,
             0.5 * tau * tau * a, tau * tau * tau / 6 * a);
}

Mat9 Preintegration::covariance(Time t) const {
  const double s = clamp(since_begin(t));
  if (s <= 0) return Mat9::Zero();
  const std::size_t k = find(s);
  const std::size_t stored = (k - first_interval_) / kErrorStride;
  Errors errors = errors_[stored];
  for (std::size_t i = first_interval_ + stored * kErrorStride; i < k; ++i) advance_errors(i, errors);

  const Interval& interval = intervals_[k];
  const double tau = s - interval.s;
  const Motion here = evaluate(interval, s);
  ErrorBlocks sum = errors.done;
  if (k > first_interval_) sum.carry(here.dv - interval.v, here.dp - interval.p - tau * interval.v, tau);
  if (gap_[k]) add_gap(sum, k, s);
  add_shares(k, tau * interval.per_length, errors.shares);
  for (std::ptrdiff_t i = 0; i < weights_.cols(); ++i)
    add_sample(sum, static_cast<std::ptrdiff_t>(k) - weights_.cols() / 2 + 1 + i,
               errors.shares[static_cast<std::size_t>(i)], here);

  const Mat3& R = here.dR;  // rotation errors on the right of dR: Rt eta
  const Mat3 PR = sum.PR * R, RV = R.transpose() * sum.VR.transpose();
  Mat9 out;
  out << sum.PP, PR, sum.PV,                           //
      PR.transpose(), R.transpose() * sum.RR * R, RV,  //
      sum.PV.transpose(), RV.transpose(), sum.VV;
  return 0.5 * (out + out.transpose());
}

}  // namespace idol
