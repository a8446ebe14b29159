// Covariance of a preintegrated motion. A sample's noise acts while the sample carries its signal: over the
// intervals on both sides, its share rising and falling linearly. Errors of rotation are taken on the left of
// dR, where they only add up: R_true = Exp(eta) R; the errors of velocity grow by -hat(a) eta and the turned
// noise of the accelerometer, those of position by those of velocity.
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
  const Mat3 VR1 = VR - cross(dv, RR);
  const Mat3 PR1 = PR + h * VR - cross(dp, RR);
  const Mat3 PV1 = PV + h * VV - cross(dp, RV);  // new position, old velocity
  PP += h * PV.transpose() - cross(dp, RP) + h * PV1 - cross_right(PR1, dp);
  PV = PV1 - cross_right(PR1, dv);
  VV -= cross(dv, RV) + cross_right(VR1, dv);
  VR = VR1;
  PR = PR1;
}

// Noise that acted with the weight `c` [s], on average `lag` [s] ago; gyro, accel: its covariances in the
// frame of the window's begin. `a` the acceleration since then.
void Preintegration::ErrorBlocks::add(const Mat3& gyro, const Mat3& accel, const Vec3& a, double c,
                                      double lag) {
  const Mat3 G = c * c * gyro, A = c * c * accel;
  const Mat3 XG = lag * cross(a, G), XGX = lag * cross_right(XG, a);
  RR += G;
  VR -= XG;
  PR -= 0.5 * lag * XG;
  VV += A + XGX;
  PV += lag * A + 0.5 * lag * XGX;
  PP += lag * lag * (A + 0.25 * XGX);
}

void Preintegration::build_covariance(PreparedSamples& samples) {
  gap_ = std::move(samples.gap);
  gyro_variance_ = std::move(samples.gyro_variance);
  accel_variance_ = std::move(samples.accel_variance);
  ErrorBlocks errors;
  for (std::size_t k = first_interval_; k < intervals_.size(); ++k) {
    if ((k - first_interval_) % kErrorStride == 0) errors_.push_back(errors);
    if (k + 1 < intervals_.size()) advance_errors(k, errors);
  }
}

// From the begin of interval k, with the samples before its own, to its end, with its own.
void Preintegration::advance_errors(std::size_t k, ErrorBlocks& errors) const {
  const Interval &from = intervals_[k], &to = intervals_[k + 1];
  if (k == first_interval_) {
    add_own_share(errors, k, to.s);
  } else {
    const double c = rising_share(k).first + 0.5 * from.length;
    errors.RR += c * c * turned(from.R, gyro_variance_[k]);
    errors.VV += c * c * turned(from.R, accel_variance_[k]);
    errors.carry(to.v - from.v, to.p - from.p - from.length * from.v, from.length);
  }
  if (gap_[k]) add_gap(errors, k, to.s);
}

void Preintegration::add_gap(ErrorBlocks& errors, std::size_t k, double s) const {
  const double gyro = options_.gap_gyro_sigma, accel = options_.gap_accel_sigma;
  const double tau = s - std::max(intervals_[k].s, 0.0);
  errors.add(gyro * gyro * Mat3::Identity(), accel * accel * Mat3::Identity(), acceleration(k), tau,
             0.5 * tau);
}

// Weight [s] of the sample at the begin of interval k in the interval before, and its moment about that time
// [s^2].
std::pair<double, double> Preintegration::rising_share(std::size_t k) const {
  if (k <= first_interval_) return {0, 0};
  const Interval& before = intervals_[k - 1];
  const double h = before.length, u0 = k - 1 == first_interval_ ? -before.s / h : 0;
  return {0.5 * h * (1 - u0 * u0), h * h * ((1 - u0 * u0 * u0) / 3 - 0.5 * (1 - u0 * u0))};
}

// Of the sample at the begin of interval k: its rising share in the interval before and its falling one up to
// s.
void Preintegration::add_own_share(ErrorBlocks& errors, std::size_t k, double s) const {
  const Interval& interval = intervals_[k];
  const double h = interval.length;
  const auto fallen = [](double u) { return u - 0.5 * u * u; };
  const auto fallen_moment = [](double u) { return 0.5 * u * u - u * u * u / 3; };
  const double u = (s - interval.s) / h, u0 = k == first_interval_ ? -interval.s / h : 0;
  auto [weight, moment] = rising_share(k);
  weight += h * (fallen(u) - fallen(u0));
  moment += h * h * (fallen_moment(u) - fallen_moment(u0));
  if (weight > 0)
    errors.add(turned(interval.R, gyro_variance_[k]), turned(interval.R, accel_variance_[k]), acceleration(k),
               weight, s - interval.s - moment / weight);
}

// Of the sample at the end of interval k: its rising share up to s.
void Preintegration::add_next_share(ErrorBlocks& errors, std::size_t k, double s) const {
  const Interval& interval = intervals_[k];
  const double h = interval.length;
  const double u = (s - interval.s) / h, u0 = k == first_interval_ ? -interval.s / h : 0;
  const double weight = 0.5 * h * (u * u - u0 * u0);
  const double moment = h * h * (u * u * u - u0 * u0 * u0) / 3;
  if (weight > 0)
    errors.add(turned(interval.R, gyro_variance_[k + 1]), turned(interval.R, accel_variance_[k + 1]),
               acceleration(k), weight, s - interval.s - moment / weight);
}

Mat9 Preintegration::covariance(Time t) const {
  const double s = clamp(since_begin(t));
  if (s <= 0) return Mat9::Zero();
  const std::size_t k = find(s);
  const std::size_t stored = (k - first_interval_) / kErrorStride;
  ErrorBlocks errors = errors_[stored];
  for (std::size_t i = first_interval_ + stored * kErrorStride; i < k; ++i) advance_errors(i, errors);

  const Interval& interval = intervals_[k];
  const double tau = s - interval.s;
  const Motion here = evaluate(interval, s);
  if (k > first_interval_) errors.carry(here.dv - interval.v, here.dp - interval.p - tau * interval.v, tau);
  if (gap_[k]) add_gap(errors, k, s);
  add_own_share(errors, k, s);
  add_next_share(errors, k, s);

  const Mat3& R = here.dR;  // rotation errors on the right of dR: Rt eta
  const Mat3 PR = errors.PR * R, RV = R.transpose() * errors.VR.transpose();
  Mat9 out;
  out << errors.PP, PR, errors.PV,                        //
      PR.transpose(), R.transpose() * errors.RR * R, RV,  //
      errors.PV.transpose(), RV.transpose(), errors.VV;
  return 0.5 * (out + out.transpose());
}

}  // namespace idol
