#include "idol/imu/preintegration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

using ConstMat3Map = Eigen::Map<const Mat3>;

double median_period(const Eigen::VectorXd& times) {
  std::vector<double> steps(static_cast<std::size_t>(times.size() - 1));
  for (std::size_t i = 0; i < steps.size(); ++i)
    steps[i] = times[static_cast<Eigen::Index>(i) + 1] - times[static_cast<Eigen::Index>(i)];
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

// Noise variance of one sample over the variance of the signal, for all channels together.
double noise_ratio(const Eigen::MatrixXd& values, double density, double period) {
  const double noise_variance = density * density / period;
  const Eigen::MatrixXd centred = values.rowwise() - values.colwise().mean();
  const double total = centred.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(1, values.size() - 3));
  // A signal quieter than its own noise is smoothed as if it had a tenth of it.
  const double signal_variance = std::max(total - noise_variance, 0.1 * noise_variance);
  return signal_variance > 0 ? noise_variance / signal_variance : 1e-9;
}

}  // namespace

NavState predict(const NavState& begin, const Preintegrated& motion, const ImuBias& bias, const Vec3& gravity) {
  const Vec3 dbg = begin.bias.gyro - bias.gyro;
  const Vec3 dba = begin.bias.accel - bias.accel;
  const double dt = motion.dt;
  NavState out;
  out.t = begin.t + from_seconds(dt);
  out.bias = begin.bias;
  out.T_w_i.q = (begin.T_w_i.q * Quat(motion.dR) * quat_exp(motion.d_R_d_bg * dbg)).normalized();
  out.v_w = begin.v_w + gravity * dt + begin.T_w_i.q * (motion.dv + motion.d_v_d_bg * dbg + motion.d_v_d_ba * dba);
  out.T_w_i.p = begin.T_w_i.p + begin.v_w * dt + 0.5 * dt * dt * gravity +
                begin.T_w_i.q * (motion.dp + motion.d_p_d_bg * dbg + motion.d_p_d_ba * dba);
  return out;
}

Preintegration::Preintegration(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias,
                               const ImuNoise& noise, const PreintegrationOptions& options)
    : begin_(begin), end_(end), bias_(bias), noise_(noise), options_(options) {
  if (samples.size() < 2)
    throw DataError(fmt::format("only {} IMU samples around {:.6f} s: at least two are needed", samples.size(),
                                static_cast<double>(begin) / kNsPerS));
  Eigen::VectorXd times(static_cast<Eigen::Index>(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i)
    times[static_cast<Eigen::Index>(i)] = since_begin(samples[i].t);
  period_s_ = median_period(times);
  build_rotation(samples, times);
  build_velocity(samples, times);
  build_covariance(samples);
}

// Exact integral of the rate plus the first commutator of the Magnus series (fourth order in the step), for
// dR/dt = R hat(w): Omega = int w + h^2/12 w(a) x w(b).
Preintegration::Node Preintegration::step(const Node& from, double s) const {
  const double h = s - from.s;
  Node to;
  to.s = s;
  to.rate = gyro_->value(s);
  const Vec3 omega = Vec3(gyro_->integral(from.s, s)) + h * h / 12 * from.rate.cross(to.rate);
  const Mat3 E = so3_exp(omega);
  to.R = from.R * E;
  to.d_R_d_bg = E.transpose() * from.d_R_d_bg - right_jacobian(omega) * h;
  return to;
}

void Preintegration::build_rotation(std::span<const ImuSample> samples, const Eigen::VectorXd& times) {
  Eigen::MatrixXd rates(times.size(), 3);
  for (Eigen::Index i = 0; i < times.size(); ++i)
    rates.row(i) = samples[static_cast<std::size_t>(i)].gyro - bias_.gyro;
  gyro_ = std::make_unique<GaussianProcess>(times, rates, options_.length_scale_samples * period_s_,
                                            noise_ratio(rates, noise_.gyro_density, period_s_));
  Node origin;
  origin.rate = gyro_->value(0);
  const double h = std::min(options_.max_step_s, period_s_);
  const auto grid = [&](double last, std::vector<Node>& nodes) {
    const int steps = static_cast<int>(std::ceil(std::abs(last) / h));
    nodes.push_back(origin);
    for (int k = 1; k <= steps; ++k) nodes.push_back(step(nodes.back(), last * k / steps));
  };
  grid(std::max(since_begin(end_), times.tail<1>()[0]), forward_);
  grid(std::min(0.0, times[0]), backward_);
}

const Preintegration::Node& Preintegration::node_before(double s) const {
  const auto& nodes = s >= 0 ? forward_ : backward_;
  if (nodes.size() < 2) return nodes.front();
  const double spacing = nodes.back().s / static_cast<double>(nodes.size() - 1);
  const auto index = static_cast<std::ptrdiff_t>(std::floor(s / spacing));
  return nodes[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(index, 0, std::ssize(nodes) - 1))];
}

// Accelerations turned into the begin frame, f_w = R (f - ba), and their derivatives with respect to the biases:
// d f_w / d ba = -R, d f_w / d bg = -R hat(f - ba) d_R_d_bg. The GP is linear, so its integrals of the derivatives
// are the derivatives of its integrals.
void Preintegration::build_velocity(std::span<const ImuSample> samples, const Eigen::VectorXd& times) {
  Eigen::MatrixXd channels(times.size(), 21);
  for (Eigen::Index i = 0; i < times.size(); ++i) {
    const Node node = step(node_before(times[i]), times[i]);
    const Vec3 f = samples[static_cast<std::size_t>(i)].accel - bias_.accel;
    const Mat3 d_ba = -node.R;
    const Mat3 d_bg = -node.R * hat(f) * node.d_R_d_bg;
    channels.row(i).head<3>() = node.R * f;
    channels.row(i).segment<9>(3) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(d_ba.data());
    channels.row(i).segment<9>(12) = Eigen::Map<const Eigen::Matrix<double, 1, 9>>(d_bg.data());
  }
  accel_ = std::make_unique<GaussianProcess>(times, channels, options_.length_scale_samples * period_s_,
                                             noise_ratio(channels.leftCols(3), noise_.accel_density, period_s_));
}

Preintegrated Preintegration::at(Time t) const {
  const double s = since_begin(t);
  const Node node = step(node_before(s), s);
  const Eigen::MatrixX2d integrals = accel_->integrals(0, s);
  Preintegrated out;
  out.dt = s;
  out.dR = node.R;
  out.d_R_d_bg = node.d_R_d_bg;
  out.dv = integrals.col(0).head<3>();
  out.d_v_d_ba = ConstMat3Map(integrals.col(0).data() + 3);
  out.d_v_d_bg = ConstMat3Map(integrals.col(0).data() + 12);
  out.dp = integrals.col(1).head<3>();
  out.d_p_d_ba = ConstMat3Map(integrals.col(1).data() + 3);
  out.d_p_d_bg = ConstMat3Map(integrals.col(1).data() + 12);
  return out;
}

// Discrete propagation of (dp, dtheta, dv) errors over one step (Forster et al. 2017, eq. 63, in our order).
Mat9 Preintegration::propagate(const Node& from, double s, bool in_gap) const {
  const double h = s - from.s;
  const Node to = step(from, s);
  const Vec3 a = accel_->value(0.5 * (from.s + s)).head<3>();
  const Mat3 E = to.R.transpose() * from.R;
  const Mat3 tilt = -hat(a) * from.R;
  Mat9 A = Mat9::Identity();
  A.block<3, 3>(0, 3) = 0.5 * h * h * tilt;
  A.block<3, 3>(0, 6) = h * Mat3::Identity();
  A.block<3, 3>(3, 3) = E;
  A.block<3, 3>(6, 3) = h * tilt;
  double gyro_variance = noise_.gyro_density * noise_.gyro_density * h;
  double accel_variance = noise_.accel_density * noise_.accel_density * h;
  if (in_gap) {
    // The rate is unknown but constant over the gap: steps add in amplitude, bounded here by the gap's own length.
    gyro_variance += std::pow(options_.gap_gyro_sigma, 2) * h * options_.max_gap_s;
    accel_variance += std::pow(options_.gap_accel_sigma, 2) * h * options_.max_gap_s;
  }
  Mat9 out = A * from.covariance * A.transpose();
  out.block<3, 3>(0, 0).diagonal().array() += accel_variance * h * h / 3;
  out.block<3, 3>(0, 6).diagonal().array() += accel_variance * h / 2;
  out.block<3, 3>(6, 0).diagonal().array() += accel_variance * h / 2;
  out.block<3, 3>(3, 3).diagonal().array() += gyro_variance;
  out.block<3, 3>(6, 6).diagonal().array() += accel_variance;
  return out;
}

void Preintegration::build_covariance(std::span<const ImuSample> samples) {
  gap_.assign(forward_.size() + 1, false);
  auto next = samples.begin();
  for (std::size_t i = 1; i < forward_.size(); ++i) {
    const Time middle = begin_ + from_seconds(0.5 * (forward_[i - 1].s + forward_[i].s));
    while (next != samples.end() && next->t < middle) ++next;
    gap_[i] = next == samples.begin() || next == samples.end() ||
              seconds_between((next - 1)->t, next->t) > options_.max_gap_s;
    forward_[i].covariance = propagate(forward_[i - 1], forward_[i].s, gap_[i]);
  }
}

Mat9 Preintegration::covariance(Time t) const {
  const double s = since_begin(t);
  const Node& node = node_before(s);
  const auto index = static_cast<std::size_t>(&node - forward_.data());
  return propagate(node, s, gap_[std::min(index + 1, forward_.size() - 1)]);
}

Vec3 Preintegration::angular_rate(Time t) const { return gyro_->value(since_begin(t)); }

}  // namespace idol
