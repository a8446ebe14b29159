#include "idol/imu/preintegration.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

namespace idol {
namespace {

// Noise variance of one sample over the variance of the signal, for all axes together.
double noise_ratio(std::span<const Vec3> values, double noise_variance) {
  Vec3 mean = Vec3::Zero();
  for (const Vec3& v : values) mean += v / static_cast<double>(values.size());
  double total = 0;
  for (const Vec3& v : values) total += (v - mean).squaredNorm();
  total /= 3 * static_cast<double>(std::max<std::size_t>(2, values.size()) - 1);
  // A signal quieter than its own noise is smoothed as if it had a tenth of it.
  const double signal_variance = std::max(total - noise_variance, 0.1 * noise_variance);
  return signal_variance > 0 ? noise_variance / signal_variance : 0;
}

// The rotation vector from u = 0 on: d theta / du = w + theta x w / 2 + theta x (theta x w) / 12 + ..., the
// inverse of the right Jacobian, solved power by power. The term left out is of fifth order in a step's
// angle, and vanishes while the axis stays.
FitPolynomial rotation_since_begin(const FitPolynomial& rate) {
  std::array<Vec3, kFitCoefficients> w, once;  // once: theta x w
  std::array<Vec3, kFitCoefficients + 1> theta;
  for (int i = 0; i < kFitCoefficients; ++i) w[static_cast<std::size_t>(i)] = rate.row(i);
  theta[1] = w[0];
  once[0] = once[1] = Vec3::Zero();
  for (std::size_t n = 1; n < kFitCoefficients; ++n) {
    Vec3 c = Vec3::Zero(), twice = Vec3::Zero();
    for (std::size_t j = 1; j <= n; ++j) c += theta[j].cross(w[n - j]);
    once[n] = c;
    for (std::size_t j = 1; j + 2 <= n; ++j) twice += theta[j].cross(once[n - j]);
    theta[n + 1] = (w[n] + 0.5 * c + twice / 12) / static_cast<double>(n + 1);
  }
  FitPolynomial out;
  for (int i = 0; i < kFitCoefficients; ++i) out.row(i) = theta[static_cast<std::size_t>(i) + 1];
  return out;
}

// so3_exp, without sine and cosine while their series are exact to the last digit.
Mat3 rotation(const Vec3& theta) {
  const double x = theta.squaredNorm();
  if (x > 0.2) return so3_exp(theta);
  constexpr double kSine[] = {1,           -1. / 6,        1. / 120,        -1. / 5040,
                              1. / 362880, -1. / 39916800, 1. / 6227020800.};  // of sin(a) / a in a^2
  constexpr double kCosine[] = {1. / 2,       -1. / 24,        1. / 720,         -1. / 40320,
                                1. / 3628800, -1. / 479001600, 1. / 87178291200.};  // of (1 - cos a) / a^2
  double a = kSine[6], b = kCosine[6];
  for (int i = 5; i >= 0; --i) {
    a = a * x + kSine[i];
    b = b * x + kCosine[i];
  }
  const double p = theta.x(), q = theta.y(), r = theta.z();
  const double c = 1 - b * x;  // cosine
  Mat3 E;
  E << c + b * p * p, b * p * q - a * r, b * p * r + a * q,  //
      b * p * q + a * r, c + b * q * q, b * q * r - a * p,   //
      b * p * r - a * q, b * q * r + a * p, c + b * r * r;
  return E;
}

using Powers = Eigen::Matrix<double, kFitCoefficients, 1>;

// 1, u, ..., u^7; by pairs, as the processor will load them again.
Powers powers_of(double u) {
  Powers out;
  const double square = u * u;
  Vec2 pair(1, u);
  out.head<2>() = pair;
  for (int i = 2; i < kFitCoefficients; i += 2) out.segment<2>(i) = pair = square * pair;
  return out;
}

// Factors of the coefficients in the polynomial's first and second integral.
alignas(16) constexpr std::array<double, kFitCoefficients> kOnce = {1,      1. / 2, 1. / 3, 1. / 4,
                                                                    1. / 5, 1. / 6, 1. / 7, 1. / 8};
alignas(16) constexpr std::array<double, kFitCoefficients> kTwice = {1. / 2,  1. / 6,  1. / 12, 1. / 20,
                                                                     1. / 30, 1. / 42, 1. / 56, 1. / 72};
Powers scaled(const Powers& powers, const std::array<double, kFitCoefficients>& factors) {
  return powers.cwiseProduct(Eigen::Map<const Powers, Eigen::Aligned16>(factors.data()));
}

Mat3 cross_columns(const Vec3& a, const Mat3& B) {
  Mat3 out;
  for (int i = 0; i < 3; ++i) out.col(i) = a.cross(B.col(i));
  return out;
}

}  // namespace

Preintegration::Preintegration(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias,
                               const ImuNoise& noise, const PreintegrationOptions& options)
    : begin_(begin), end_(end), bias_(bias), options_(options) {
  PreparedSamples prepared = prepare_samples(samples, begin, end, bias, noise, options);
  quality_ = prepared.quality;
  const FitWeights weights = build_rotation(prepared);
  build_velocity(prepared);
  build_bias_integrals();
  build_covariance(prepared, weights);
}

// Held readings are no data: they stay out of the fits.
FitPolynomial Preintegration::fit(const IntervalFit& fit, const PreparedSamples& samples, std::size_t k,
                                  std::span<const Vec3> values) const {
  if ((samples.held_first && k == 0) || (samples.held_last && k + 2 == samples.times.size())) {
    FitPolynomial constant = FitPolynomial::Zero();
    constant.row(0) = samples.held_first && k == 0 ? values[1] : values[k];
    return constant;
  }
  const std::size_t skip = samples.held_first ? 1 : 0;
  return fit(k - skip, values.subspan(skip, values.size() - skip - (samples.held_last ? 1 : 0)));
}

FitWeights Preintegration::build_rotation(const PreparedSamples& samples) {
  const auto& times = samples.times;
  const std::size_t skip = samples.held_first ? 1 : 0;
  const auto data = std::span(times).subspan(skip, times.size() - skip - (samples.held_last ? 1 : 0));
  const IntervalFit fit_rate(data, samples.period, options_,
                             noise_ratio(samples.gyro, samples.gyro_variance[0].x()));
  last_s_ = times.back();
  intervals_.resize(times.size() - 1);
  Mat3 R = Mat3::Identity();
  for (std::size_t k = 0; k < intervals_.size(); ++k) {
    Interval& interval = intervals_[k];
    interval.s = times[k];
    interval.length = times[k + 1] - times[k];
    interval.per_length = 1 / interval.length;
    interval.R = R;
    interval.rate = interval.length * fit(fit_rate, samples, k, samples.gyro);
    interval.angle = rotation_since_begin(interval.rate);
    R = R * rotation(interval.angle.colwise().sum());
  }
  const auto stretches = std::clamp<std::size_t>(
      static_cast<std::size_t>((last_s_ - times[0]) / samples.period) + 1, 1, 4 * intervals_.size());
  lookup_per_second_ = static_cast<double>(stretches) / (last_s_ - times[0]);
  lookup_.resize(stretches);
  std::size_t k = 0;
  for (std::size_t i = 0; i < stretches; ++i) {
    while (k + 1 < intervals_.size() &&
           intervals_[k + 1].s <= times[0] + static_cast<double>(i) / lookup_per_second_)
      ++k;
    lookup_[i] = static_cast<std::uint32_t>(k);
  }
  // From the frame of the first sample to that of the window's begin.
  first_interval_ = find(0);
  const Interval& first = intervals_[first_interval_];
  const double u = -first.s / first.length;
  const Mat3 R_begin = first.R * rotation(first.angle.transpose() * (u * powers_of(u)));
  for (Interval& interval : intervals_) interval.R = R_begin.transpose() * interval.R;
  return fit_rate.regular_weights();
}

// The force is turned into the frame of the begin at the samples, where it is known, and fitted there.
void Preintegration::build_velocity(const PreparedSamples& samples) {
  const auto& times = samples.times;
  const std::size_t skip = samples.held_first ? 1 : 0;
  const auto data = std::span(times).subspan(skip, times.size() - skip - (samples.held_last ? 1 : 0));
  std::vector<Vec3> turned(times.size());
  for (std::size_t k = 0; k < intervals_.size(); ++k) turned[k] = intervals_[k].R * samples.accel[k];
  const Interval& last = intervals_.back();
  turned.back() = last.R * (rotation(last.angle.colwise().sum()) * samples.accel.back());
  const IntervalFit fit_accel(data, samples.period, options_,
                              noise_ratio(turned, samples.accel_variance[0].x()));
  for (std::size_t k = 0; k < intervals_.size(); ++k)
    intervals_[k].accel = fit(fit_accel, samples, k, turned);

  const auto gain = [](const Interval& interval, double u) {
    const Powers powers = powers_of(u);
    const double h = interval.length;
    return std::pair<Vec3, Vec3>(h * u * interval.accel.transpose() * scaled(powers, kOnce),
                                 h * h * u * u * interval.accel.transpose() * scaled(powers, kTwice));
  };
  Interval& first = intervals_[first_interval_];
  const auto [dv, dp] = gain(first, -first.s / first.length);
  first.v = -dv;
  first.p = first.s * first.v - dp;
  for (std::size_t k = first_interval_ + 1; k < intervals_.size(); ++k) {
    const Interval& from = intervals_[k - 1];
    const auto [v, p] = gain(from, 1);
    intervals_[k].v = from.v + v;
    intervals_[k].p = from.p + from.length * from.v + p;
  }
  for (std::size_t k = first_interval_; k-- > 0;) {
    Interval& to = intervals_[k];
    const auto [v, p] = gain(to, 1);
    to.v = intervals_[k + 1].v - v;
    to.p = intervals_[k + 1].p - to.length * to.v - p;
  }
}

std::size_t Preintegration::find(double s) const {
  const double stretch = (s - intervals_[0].s) * lookup_per_second_;
  const auto i = stretch > 0 ? std::min(static_cast<std::size_t>(stretch), lookup_.size() - 1) : 0;
  std::size_t k = lookup_[i];
  while (k + 1 < intervals_.size() && intervals_[k + 1].s <= s) ++k;
  return k;
}

double Preintegration::clamp(double s) const { return std::clamp(s, intervals_[0].s, last_s_); }

Motion Preintegration::evaluate(const Interval& interval, double s) {
  const double tau = s - interval.s;
  const double u = tau * interval.per_length;
  const Powers powers = powers_of(u);
  const Vec3 theta = interval.angle.transpose() * (u * powers);
  Motion out;
  out.dt = s;
  out.dR = interval.R * rotation(theta);
  out.dv = interval.v + tau * (interval.accel.transpose() * scaled(powers, kOnce));
  out.dp = interval.p + tau * interval.v + tau * tau * (interval.accel.transpose() * scaled(powers, kTwice));
  return out;
}

Motion Preintegration::motion(Time t) const {
  const double s = clamp(since_begin(t));
  return evaluate(intervals_[find(s)], s);
}

void Preintegration::motions(std::span<const Time> times, std::span<Motion> out) const {
  assert(times.size() == out.size());
  for (std::size_t i = 0; i < times.size(); ++i) out[i] = motion(times[i]);
}

Preintegration::Local Preintegration::local(const Interval& interval, double u, const Mat3& R) {
  const Powers powers = powers_of(u);
  Powers slopes;
  slopes[0] = 0;
  for (int i = 1; i < kFitCoefficients; ++i) slopes[i] = i * powers[i - 1];
  const double per_length = interval.per_length;
  return {R, per_length * (interval.rate.transpose() * powers), interval.accel.transpose() * powers,
          per_length * (interval.accel.transpose() * slopes)};
}

// The trapezium rule with its end correction, h/2 (f0 + f1) + h^2/12 (f0' - f1'): of fourth order, both ways
// in time.
Preintegration::BiasIntegrals Preintegration::integrate(const BiasIntegrals& from, const Local& a,
                                                        const Local& b, double dt) {
  const double half = 0.5 * dt, twelfth = dt * dt / 12;
  BiasIntegrals to;
  to.K = from.K + half * (a.R + b.R) + twelfth * (a.R * hat(a.rate) - b.R * hat(b.rate));
  to.L = from.L + half * (from.K + to.K) + twelfth * (a.R - b.R);
  const Mat3 ga = cross_columns(a.accel, from.K), gb = cross_columns(b.accel, to.K);
  const Mat3 slope = cross_columns(a.jerk, from.K) + cross_columns(a.accel, a.R) -
                     cross_columns(b.jerk, to.K) - cross_columns(b.accel, b.R);
  to.M = from.M + half * (ga + gb) + twelfth * slope;
  to.N = from.N + half * (from.M + to.M) + twelfth * (ga - gb);
  return to;
}

void Preintegration::build_bias_integrals() {
  bias_integrals_.resize(intervals_.size());
  const auto at_begin = [](const Interval& interval) { return local(interval, 0, interval.R); };
  const Interval& first = intervals_[first_interval_];
  const Local begin = local(first, -first.s / first.length, Mat3::Identity());
  rate_at_begin_ = begin.rate;
  accel_at_begin_ = begin.accel;
  bias_integrals_[first_interval_] = integrate({}, begin, at_begin(first), first.s);
  Local here = at_begin(first);
  for (std::size_t k = first_interval_ + 1; k < intervals_.size(); ++k) {
    const Local next = at_begin(intervals_[k]);
    bias_integrals_[k] = integrate(bias_integrals_[k - 1], here, next, intervals_[k - 1].length);
    here = next;
  }
  here = at_begin(first);
  for (std::size_t k = first_interval_; k-- > 0;) {
    const Local before = at_begin(intervals_[k]);
    bias_integrals_[k] = integrate(bias_integrals_[k + 1], here, before, -intervals_[k].length);
    here = before;
  }
}

Preintegrated Preintegration::at(Time t) const {
  const double s = clamp(since_begin(t));
  const std::size_t k = find(s);
  const Interval& interval = intervals_[k];
  Preintegrated out;
  static_cast<Motion&>(out) = evaluate(interval, s);
  const Local here = local(interval, (s - interval.s) * interval.per_length, out.dR);
  const BiasIntegrals sums =
      integrate(bias_integrals_[k], local(interval, 0, interval.R), here, s - interval.s);
  out.d_R_d_bg = -out.dR.transpose() * sums.K;
  out.d_v_d_bg = sums.M;
  out.d_v_d_ba = -sums.K;
  out.d_p_d_bg = sums.N;
  out.d_p_d_ba = -sums.L;
  out.rate = here.rate;
  out.accel = here.accel;
  // Of R_b^T R_t, int R_b^T R f and int (t - s) R_b^T R f by both of their ends.
  out.d_R_d_shift = here.rate - out.dR.transpose() * rate_at_begin_;
  out.d_v_d_shift = here.accel - accel_at_begin_ - rate_at_begin_.cross(out.dv);
  out.d_p_d_shift = out.dv - s * accel_at_begin_ - rate_at_begin_.cross(out.dp);
  return out;
}

Vec3 Preintegration::angular_rate(Time t) const {
  const double s = clamp(since_begin(t));
  const Interval& interval = intervals_[find(s)];
  return interval.per_length *
         (interval.rate.transpose() * powers_of((s - interval.s) * interval.per_length));
}

}  // namespace idol
