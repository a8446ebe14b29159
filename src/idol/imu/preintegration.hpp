// Continuous inertial representation of a window: the motion from its begin to any time, by one of three
// models of the signals between the samples (paper III-B and eq. 4 for gpm; docs/preintegration.md).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/imu/interval_fit.hpp"
#include "idol/imu/preintegration_options.hpp"
#include "idol/imu/prepared_samples.hpp"

namespace idol {

using Mat9 = Eigen::Matrix<double, 9, 9>;

/// Motion from a window's begin to one time, in the IMU frame at the begin, without gravity and initial
/// velocity: dR = R_b^T R_t, dv = R_b^T (v_t - v_b - g dt), dp = R_b^T (p_t - p_b - v_b dt - g dt^2 / 2).
struct Motion {
  double dt = 0;  ///< [s]
  Mat3 dR = Mat3::Identity();
  Vec3 dv = Vec3::Zero();  ///< [m/s]
  Vec3 dp = Vec3::Zero();  ///< [m]
};

/// With its derivatives. Linear in small changes of the biases it was computed with (Forster et al. 2017, eq.
/// 44): R(b) = dR Exp(d_R_d_bg dbg), v(b) = dv + d_v_d_bg dbg + d_v_d_ba dba, and so p. d_x_d_shift: both
/// ends of the span move along the recording by one second (t_imu = t_camera + shift).
struct Preintegrated : Motion {
  Mat3 d_R_d_bg = Mat3::Zero();
  Mat3 d_v_d_bg = Mat3::Zero(), d_v_d_ba = Mat3::Zero();
  Mat3 d_p_d_bg = Mat3::Zero(), d_p_d_ba = Mat3::Zero();
  Vec3 d_R_d_shift = Vec3::Zero(), d_v_d_shift = Vec3::Zero(), d_p_d_shift = Vec3::Zero();
  Vec3 rate = Vec3::Zero();   ///< corrected angular rate at the time, in the IMU frame there [rad/s]: d dR /
                              ///< dt = dR hat(rate)
  Vec3 accel = Vec3::Zero();  ///< d dv / dt, in the frame of the begin [m/s^2]
};

/// dX(0,2) = dX(0,1) * dX(1,2); the Jacobians to the biases and to the shift go with it. `rate` and `accel`
/// are the second's.
Motion operator*(const Motion& first, const Motion& second);
Preintegrated operator*(const Preintegrated& first, const Preintegrated& second);
/// dX(1,0) from dX(0,1).
Motion inverse(const Motion& motion);
/// Covariance of inverse(motion) from that of `motion`, both of (dp, dtheta, dv).
Mat9 inverse_covariance(const Motion& motion, const Mat9& covariance);

/// State at the preintegrated time from the state at the window's begin (paper eq. 4). The biases used are
/// those of `begin`; `bias` are those that the preintegration was computed with. `gravity` in the world
/// [m/s^2].
NavState predict(const NavState& begin, const Preintegrated& motion, const ImuBias& bias,
                 const Vec3& gravity);

/// The inertial data of one window, to be asked at any time of [begin, end] (and of the samples given
/// beyond). Build time is linear in the number of samples; a query takes the same time whatever their number.
class Preintegration {
 public:
  /// `samples`: time-ordered, spanning [begin, end] and preferably margin_samples more on each side; at least
  /// two. Throws DataError if there are fewer.
  Preintegration(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias,
                 const ImuNoise& noise, const PreintegrationOptions& options);

  /// Times outside the samples count as the nearest inside.
  [[nodiscard]] Preintegrated at(Time t) const;
  [[nodiscard]] Motion motion(Time t) const;
  /// Motions at many times, one each. `out` as long as `times`.
  void motions(std::span<const Time> times, std::span<Motion> out) const;
  /// Covariance of (dp, dtheta, dv) at `t` from the noise of the samples, gaps and saturation alone (biases
  /// excluded), 9 x 9; dtheta on the right of dR. Zero before the begin.
  [[nodiscard]] Mat9 covariance(Time t) const;
  /// Corrected angular rate at `t`, in the IMU frame.
  [[nodiscard]] Vec3 angular_rate(Time t) const;

  [[nodiscard]] Time begin() const { return begin_; }
  [[nodiscard]] Time end() const { return end_; }
  [[nodiscard]] const ImuBias& bias() const { return bias_; }
  /// What was odd in the samples: the caller decides whether the window is still to be trusted.
  [[nodiscard]] const SampleQuality& quality() const { return quality_; }

 private:
  // Between two samples, u = (s - begin of the interval) / length in [0, 1].
  struct Interval {
    double s = 0, length = 0;  // [s]
    Mat3 R;                    // at u = 0, and so v and p
    Vec3 v, p;
    FitPolynomial rate;   // angular rate x length, in the IMU frame
    FitPolynomial angle;  // rotation since u = 0: row i the coefficient of u^(i+1)
    FitPolynomial accel;  // in the frame of the window's begin
  };
  // K = int R, L = int K, M = int hat(a) K, N = int M: the derivatives to the biases, all in the frame of the
  // begin.
  struct BiasIntegrals {
    Mat3 K = Mat3::Zero(), L = Mat3::Zero(), M = Mat3::Zero(), N = Mat3::Zero();
  };
  // What changes the integrals at one instant.
  struct Local {
    Mat3 R;
    Vec3 rate, accel, jerk;
  };

  [[nodiscard]] double since_begin(Time t) const { return seconds_between(begin_, t); }
  [[nodiscard]] std::size_t find(double s) const;
  [[nodiscard]] double clamp(double s) const;
  [[nodiscard]] static Motion evaluate(const Interval& interval, double s);
  [[nodiscard]] static Local local(const Interval& interval, double u, const Mat3& R);
  [[nodiscard]] static BiasIntegrals integrate(const BiasIntegrals& from, const Local& a, const Local& b,
                                               double dt);

  void build_rotation(const PreparedSamples& samples);
  void build_velocity(const PreparedSamples& samples);
  void build_bias_integrals();
  void build_covariance(const PreparedSamples& samples);
  [[nodiscard]] FitPolynomial fit(const IntervalFit& fit, const PreparedSamples& samples, std::size_t k,
                                  std::span<const Vec3> values) const;
  [[nodiscard]] Mat9 carried(std::size_t k, double s) const;
  void add_own_share(Mat9& S, std::size_t k, double s) const;
  void add_next_share(Mat9& S, std::size_t k, double s) const;
  [[nodiscard]] Vec3 acceleration(std::size_t k) const { return intervals_[k].accel.row(0); }

  Time begin_, end_;
  ImuBias bias_;
  PreintegrationOptions options_;
  SampleQuality quality_;
  double last_s_ = 0;
  Vec3 rate_at_begin_, accel_at_begin_;
  std::size_t first_interval_ = 0;  // the one that holds the begin
  std::vector<Interval> intervals_;
  std::vector<std::uint32_t> lookup_;  // first interval that reaches into each of equal stretches of time
  double lookup_length_ = 0;
  std::vector<BiasIntegrals> bias_integrals_;  // at each interval's begin
  // At each interval's begin, from first_interval_ on, in the order rotation (left of dR), velocity,
  // position: what the samples whose share ends there have brought.
  std::vector<Mat9> covariance_;
  std::vector<Mat3> gyro_noise_, accel_noise_;  // of each sample, turned into the frame of the begin
  std::vector<bool> gap_;
};

}  // namespace idol
