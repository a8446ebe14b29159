// Covariance of a preintegrated motion. A sample's noise acts as long as the sample is its signal's support:
// over the intervals on both sides, falling linearly. Errors of rotation are taken on the left of dR, where
// they only add up: R_true = Exp(eta) R, d/ds of the errors of velocity and position = -hat(a) eta + R n_a,
// and that once more.
#include <algorithm>

#include "idol/imu/preintegration.hpp"

namespace idol {
namespace {

enum { kR = 0, kV = 3, kP = 6 };  // places in the covariance

// Errors at one time carried to a later one, when the velocity has grown by dv and the position by dp beyond
// h times it.
void carry(Mat9& S, const Vec3& dv, const Vec3& dp, double h) {
  const Mat3 X = hat(dv), Y = hat(dp);
  S.middleRows<3>(kP) += h * S.middleRows<3>(kV) - Y * S.middleRows<3>(kR);
  S.middleRows<3>(kV) -= X * S.middleRows<3>(kR);
  S.middleCols<3>(kP) += h * S.middleCols<3>(kV) - S.middleCols<3>(kR) * Y.transpose();
  S.middleCols<3>(kV) -= S.middleCols<3>(kR) * X.transpose();
}

// Noise that acted with the weight `c` [s], on average `lag` [s] ago; gyro, accel: its covariances in the
// frame of the begin. `a` the acceleration since then.
void add_noise(Mat9& S, const Mat3& gyro, const Mat3& accel, const Vec3& a, double c, double lag) {
  Eigen::Matrix<double, 9, 3> from_gyro, from_accel;
  from_gyro << Mat3::Identity(), -lag * hat(a), -0.5 * lag * lag * hat(a);
  from_accel << Mat3::Zero(), Mat3::Identity(), lag * Mat3::Identity();
  S += c * c * (from_gyro * gyro * from_gyro.transpose() + from_accel * accel * from_accel.transpose());
}

// Turns a diagonal covariance; one that looks the same from all sides needs no turning.
Mat3 turned(const Mat3& R, const Vec3& variance) {
  if (variance.x() == variance.y() && variance.y() == variance.z()) return variance.x() * Mat3::Identity();
  return R * variance.asDiagonal() * R.transpose();
}

}  // namespace

void Preintegration::build_covariance(const PreparedSamples& samples) {
  const std::size_t count = samples.times.size();
  gap_ = samples.gap;
  gyro_noise_.resize(count);
  accel_noise_.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Mat3& R = intervals_[std::min(i, intervals_.size() - 1)].R;
    gyro_noise_[i] = turned(R, samples.gyro_variance[i]);
    accel_noise_[i] = turned(R, samples.accel_variance[i]);
  }
  covariance_.assign(intervals_.size(), Mat9::Zero());
  for (std::size_t k = first_interval_; k + 1 < intervals_.size(); ++k) {
    covariance_[k + 1] = carried(k, intervals_[k + 1].s);
    add_own_share(covariance_[k + 1], k, intervals_[k + 1].s);
  }
}

// What came before interval k, seen at s in it; and the gap up to there, if it is one.
Mat9 Preintegration::carried(std::size_t k, double s) const {
  const Interval& interval = intervals_[k];
  const double tau = s - std::max(interval.s, 0.0);
  const Motion here = evaluate(interval, s);
  Mat9 S = covariance_[k];
  if (k != first_interval_) carry(S, here.dv - interval.v, here.dp - interval.p - tau * interval.v, tau);
  if (gap_[k]) {
    const double gyro = options_.gap_gyro_sigma, accel = options_.gap_accel_sigma;
    add_noise(S, gyro * gyro * Mat3::Identity(), accel * accel * Mat3::Identity(), acceleration(k), tau,
              0.5 * tau);
  }
  return S;
}

// Of the sample at the begin of interval k: its rising share in the interval before and its falling one up to
// s.
void Preintegration::add_own_share(Mat9& S, std::size_t k, double s) const {
  const Interval& interval = intervals_[k];
  const double h = interval.length;
  double weight = 0, moment = 0;  // moment: of the weight, about the begin of the interval [s^2]
  if (k > first_interval_) {
    const Interval& before = intervals_[k - 1];
    const double u0 = k - 1 == first_interval_ ? -before.s / before.length : 0;
    weight = 0.5 * before.length * (1 - u0 * u0);
    moment = before.length * before.length * ((1 - u0 * u0 * u0) / 3 - 0.5 * (1 - u0 * u0));
  }
  const auto fallen = [](double u) { return u - 0.5 * u * u; };
  const auto fallen_moment = [](double u) { return 0.5 * u * u - u * u * u / 3; };
  const double u = (s - interval.s) / h, u0 = k == first_interval_ ? -interval.s / h : 0;
  weight += h * (fallen(u) - fallen(u0));
  moment += h * h * (fallen_moment(u) - fallen_moment(u0));
  if (weight > 0)
    add_noise(S, gyro_noise_[k], accel_noise_[k], acceleration(k), weight, s - interval.s - moment / weight);
}

// Of the sample at the end of interval k: its rising share up to s.
void Preintegration::add_next_share(Mat9& S, std::size_t k, double s) const {
  const Interval& interval = intervals_[k];
  const double h = interval.length;
  const double u = (s - interval.s) / h, u0 = k == first_interval_ ? -interval.s / h : 0;
  const double weight = 0.5 * h * (u * u - u0 * u0);
  const double moment = h * h * (u * u * u - u0 * u0 * u0) / 3;
  if (weight > 0)
    add_noise(S, gyro_noise_[k + 1], accel_noise_[k + 1], acceleration(k), weight,
              s - interval.s - moment / weight);
}

Mat9 Preintegration::covariance(Time t) const {
  const double s = clamp(since_begin(t));
  if (s <= 0) return Mat9::Zero();
  const std::size_t k = find(s);
  Mat9 S = carried(k, s);
  add_own_share(S, k, s);
  add_next_share(S, k, s);
  // From (rotation on the left, velocity, position) to (position, rotation on the right, velocity).
  const Mat3 Rt = motion(t).dR.transpose();
  Mat9 to = Mat9::Zero();
  to.block<3, 3>(0, kP).setIdentity();
  to.block<3, 3>(3, kR) = Rt;
  to.block<3, 3>(6, kV).setIdentity();
  return to * S * to.transpose();
}

}  // namespace idol
