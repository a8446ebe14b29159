// Continuous inertial representation of a window: the motion from its begin to any time, by one of three
// models of the signals between the samples (paper III-B and eq. 4 for gpm; docs/preintegration.md).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <utility>
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

/// The motion to a time `dt` later, by its rate and acceleration; for a few milliseconds. The Jacobian to the shift is
/// kept.
Preintegrated later(const Preintegrated& motion, double dt);

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
    double s = 0, length = 0, per_length = 0;  // [s], [1/s]
    Mat3 R;                                    // at u = 0, and so v and p
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

  // Covariance of the errors of rotation (on the left of dR), velocity and position, by blocks.
  struct ErrorBlocks {
    Mat3 RR = Mat3::Zero(), VR = Mat3::Zero(), PR = Mat3::Zero();
    Mat3 VV = Mat3::Zero(), PV = Mat3::Zero(), PP = Mat3::Zero();

    void carry(const Vec3& dv, const Vec3& dp, double h);
    void add(const Mat3& gyro, const Mat3& accel, double c, double cp, const Vec3& x, const Vec3& y);
  };
  // What a sample's noise is multiplied by in the integral of its signal, and that times the time since the
  // sample.
  struct Share {
    double weight = 0, moment = 0;  // [s], [s^2]
  };
  struct Errors {
    ErrorBlocks done;                           // of the samples whose shares are complete
    std::array<Share, kMostFitSamples> shares;  // of those around the interval, so far
  };

  [[nodiscard]] double since_begin(Time t) const { return seconds_between(begin_, t); }
  [[nodiscard]] std::size_t find(double s) const;
  [[nodiscard]] double clamp(double s) const;
  [[nodiscard]] static Motion evaluate(const Interval& interval, double s);
  [[nodiscard]] static Local local(const Interval& interval, double u, const Mat3& R);
  [[nodiscard]] static BiasIntegrals integrate(const BiasIntegrals& from, const Local& a, const Local& b,
                                               double dt);

  FitWeights build_rotation(const PreparedSamples& samples);  // the weights are those of a regular grid
  void build_velocity(const PreparedSamples& samples);
  void build_bias_integrals();
  void build_covariance(PreparedSamples& samples, const FitWeights& weights);
  [[nodiscard]] FitPolynomial fit(const IntervalFit& fit, const PreparedSamples& samples, std::size_t k,
                                  std::span<const Vec3> values) const;
  void add_shares(std::size_t k, double u, std::array<Share, kMostFitSamples>& shares) const;
  [[nodiscard]] std::size_t sample(std::ptrdiff_t i) const;
  void add_sample(ErrorBlocks& errors, std::ptrdiff_t i, const Share& share, const Motion& here) const;
  void advance_errors(std::size_t k, Errors& errors) const;
  void add_gap(ErrorBlocks& errors, std::size_t k, double s) const;

  Time begin_, end_;
  ImuBias bias_;
  PreintegrationOptions options_;
  SampleQuality quality_;
  double last_s_ = 0;
  Vec3 rate_at_begin_, accel_at_begin_;
  std::size_t first_interval_ = 0;  // the one that holds the begin
  std::vector<Interval> intervals_;
  std::vector<std::uint32_t> lookup_;  // first interval that reaches into each of equal stretches of time
  double lookup_per_second_ = 0;
  std::vector<BiasIntegrals> bias_integrals_;  // at each interval's begin
  static constexpr std::size_t kErrorStride = 8;
  std::vector<Errors> errors_;  // at the begin of every kErrorStride-th interval from first_interval_ on
  FitWeights weights_, linear_weights_;               // of the samples around an interval
  double usual_length_ = 0;                           // of an interval [s]
  std::vector<Vec3> gyro_variance_, accel_variance_;  // of each sample
  std::vector<bool> gap_;
};

}  // namespace idol
