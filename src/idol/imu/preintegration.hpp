// Continuous inertial representation of a window: Gaussian preintegrated measurements (paper III-B, eq. 4).
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "idol/base/options.hpp"
#include "idol/base/rig.hpp"
#include "idol/base/types.hpp"
#include "idol/imu/gp.hpp"

namespace idol {

using Mat9 = Eigen::Matrix<double, 9, 9>;

struct PreintegrationOptions {
  double length_scale_samples = 3;
  int margin_samples = 12;
  double max_step_s = 0.002;
  double max_gap_s = 0.1;
  double gap_gyro_sigma = 1.0;
  double gap_accel_sigma = 5.0;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("length_scale_samples", self.length_scale_samples, Range{0.5, 20},
          "GP length scale in IMU sample periods (Le Gentil 2020)");
    visit("margin_samples", self.margin_samples, Range{2, 200},
          "IMU samples used beyond each end of a window; the look-ahead before a window can be solved");
    visit("max_step_s", self.max_step_s, Range{1e-4, 0.02}, "longest step of the rotation's product of exponentials");
    visit("max_gap_s", self.max_gap_s, Range{0.002, 1}, "longest IMU gap that is not reported and inflated [s]");
    visit("gap_gyro_sigma", self.gap_gyro_sigma, Range{0, 100}, "unknown angular rate inside such a gap [rad/s]");
    visit("gap_accel_sigma", self.gap_accel_sigma, Range{0, 1000}, "unknown acceleration inside such a gap [m/s^2]");
  }
};

/// Motion from the window's begin to one time, in the IMU frame at the begin, without gravity and initial velocity;
/// linear in small changes of the biases it was computed with (Forster et al. 2017, eq. 44):
/// R(b) = dR Exp(d_R_d_bg dbg), v(b) = dv + d_v_d_bg dbg + d_v_d_ba dba, and so p.
struct Preintegrated {
  double dt = 0;  ///< [s]
  Mat3 dR = Mat3::Identity();
  Vec3 dv = Vec3::Zero();  ///< [m/s]
  Vec3 dp = Vec3::Zero();  ///< [m]
  Mat3 d_R_d_bg = Mat3::Zero();
  Mat3 d_v_d_bg = Mat3::Zero(), d_v_d_ba = Mat3::Zero();
  Mat3 d_p_d_bg = Mat3::Zero(), d_p_d_ba = Mat3::Zero();
};

/// State at the preintegrated time from the state at the window's begin (paper eq. 4). The biases used are those of
/// `begin`; `bias` are those that the preintegration was computed with. `gravity` in the world [m/s^2].
NavState predict(const NavState& begin, const Preintegrated& motion, const ImuBias& bias, const Vec3& gravity);

/// The inertial data of one window, to be asked at any time of [begin, end].
class Preintegration {
 public:
  /// `samples`: time-ordered, spanning [begin, end] and preferably margin_samples more on each side; at least two.
  /// Throws DataError if there are fewer.
  Preintegration(std::span<const ImuSample> samples, Time begin, Time end, const ImuBias& bias, const ImuNoise& noise,
                 const PreintegrationOptions& options);

  [[nodiscard]] Preintegrated at(Time t) const;
  /// Covariance of (dp, dtheta, dv) at `t` from the white noise of the sensor alone (biases excluded), 9 x 9.
  [[nodiscard]] Mat9 covariance(Time t) const;
  /// Corrected angular rate and specific force at `t`, in the IMU frame.
  [[nodiscard]] Vec3 angular_rate(Time t) const;

  [[nodiscard]] Time begin() const { return begin_; }
  [[nodiscard]] Time end() const { return end_; }
  [[nodiscard]] const ImuBias& bias() const { return bias_; }

 private:
  struct Node {  // of the rotation grid
    double s = 0;
    Mat3 R = Mat3::Identity();
    Mat3 d_R_d_bg = Mat3::Zero();
    Vec3 rate = Vec3::Zero();
    Mat9 covariance = Mat9::Zero();
  };

  [[nodiscard]] double since_begin(Time t) const { return seconds_between(begin_, t); }
  [[nodiscard]] Node step(const Node& from, double s) const;
  [[nodiscard]] const Node& node_before(double s) const;
  void build_rotation(std::span<const ImuSample> samples, const Eigen::VectorXd& times);
  void build_velocity(std::span<const ImuSample> samples, const Eigen::VectorXd& times);
  void build_covariance(std::span<const ImuSample> samples);
  [[nodiscard]] Mat9 propagate(const Node& from, double s, bool in_gap) const;

  Time begin_, end_;
  ImuBias bias_;
  ImuNoise noise_;
  PreintegrationOptions options_;
  double period_s_ = 0;
  std::unique_ptr<GaussianProcess> gyro_;   // 3 channels: rate
  std::unique_ptr<GaussianProcess> accel_;  // 21 channels: acceleration in the begin frame, its bias derivatives
  std::vector<Node> forward_;               // s >= 0, increasing
  std::vector<Node> backward_;              // s <= 0, decreasing: the margin before the begin
  std::vector<bool> gap_;                   // the step before forward_[i] lies in a gap of the data
};

}  // namespace idol
