// How the fixed lag starts, notices that it is lost, and starts anew.
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"
#include "idol/base/median.hpp"

namespace idol {

// Position and yaw are the gauge: known. Tilt is loose, since at rest the IMU factors tie it to the
// accelerometer's bias.
void FixedLag::start(const NavState& first, bool still) {
  states_ = {first};
  set_prior(first, still, options_.start_pose_sigma, options_.start_pose_sigma);
  gauge_ = prior_;
  settled_ = still;
}

void FixedLag::set_prior(const NavState& first, bool still, double position_sigma, double yaw_sigma) {
  constexpr double kTilt = 0.1;
  constexpr double kMounting = 0.006, kFocal = 0.003;
  StateVec sigma;
  sigma << Vec3::Constant(position_sigma), kTilt, kTilt, yaw_sigma,
      Vec3::Constant(still ? options_.start_velocity_sigma : options_.moving_velocity_sigma),
      Vec3::Constant(still ? options_.gyro_bias_sigma : options_.moving_gyro_bias_sigma),
      Vec3::Constant(options_.accel_bias_sigma), options_.time_shift_sigma, options_.event_lag_sigma_px;
  const Vec4 calibration_sigma(kMounting, kMounting, kMounting, kFocal);
  Eigen::VectorXd all(kStateDim + calibration_dim_);
  all << calibration_sigma.head(camera_dim_), uncalibrated_imu_sigma().head(imu_dim_), sigma;
  LeastSquaresRows rows{all.cwiseInverse().asDiagonal(), Eigen::VectorXd::Zero(all.size())};
  // Tilt and yaw are about the world's axes: Exp(d) R = R Exp(R^T d).
  const Eigen::Index turn = calibration_dim_ + 3;
  rows.A.block<3, 3>(turn, turn) = (rows.A.block<3, 3>(turn, turn) * first.T_w_i.R()).eval();
  eliminate_leading(rows, 0);  // makes it a triangle again
  prior_ = MarginalPrior(first, Eigen::VectorXd::Zero(calibration_dim_), {}, std::move(rows));
}

// Long without a known line while moving, or with lines that are not where they should be; or a state that no
// camera can have.
bool FixedLag::lost() const {
  constexpr double kMisfit = 0.4;  // [s]
  return blind_s_ > options_.blind_s || misfit_s_ > kMisfit || diverged(states_.back()) ||
         !(states_.back().bias.accel.norm() < options_.max_accel_bias);
}

bool FixedLag::diverged(const NavState& state) const {
  return !state.T_w_i.p.allFinite() || !(state.v_w.norm() < options_.max_speed);
}

// Of the known lines in sight, many contradict the state.
bool FixedLag::newest_misfits() const {
  constexpr int kFew = 8;
  constexpr double kShare = 1.0 / 3;
  int seen = 0, misfits = 0;
  for (const auto& [id, track] : tracks_) {
    if (!in_sight(track)) continue;
    ++seen;
    misfits += track.seen.back().rejected ? 1 : 0;
  }
  return seen >= kFew && misfits > kShare * seen;
}

// With it come tilt and scale.
bool FixedLag::knows_velocity() const {
  constexpr double kSigma = 0.02;  // [m/s]
  return covariance_ && covariance_->block<3, 3>(6, 6).diagonal().cwiseSqrt().maxCoeff() < kSigma;
}

// Goes on from the last believable pose with an unknown velocity. The map stays, out of the problem: lines
// that are found again correct the pose, which is known as well as it can be after such a time by the IMU.
// From a start that came to nothing only the turns since then are believed.
void FixedLag::restart() {
  constexpr double kGyroBias = 0.1;              // [rad/s] at switch-on, no unit has more
  constexpr double kPosition = 0.5, kYaw = 0.1;  // sigmas of the pose [m], [rad]
  ++restarts_;
  blind_s_ = misfit_s_ = 0;
  NavState now = states_.back();
  const bool absurd = diverged(now);
  if (!settled_) {
    const NavState& first = states_[begun_];
    now.T_w_i.q = (gauge_.state().T_w_i.q * first.T_w_i.q.inverse() * now.T_w_i.q).normalized();
    now.v_w.setZero();
    now.bias = gauge_.state().bias;
  }
  const NavState& believable = states_[first_];
  if (absurd) {
    now.T_w_i = believable.T_w_i;
    now.v_w = diverged(believable) ? Vec3(Vec3::Zero()) : believable.v_w;
  }
  if (!(now.bias.accel.norm() < 1)) now.bias.accel.setZero();
  if (!(now.bias.gyro.norm() < kGyroBias)) now.bias.gyro = gauge_.state().bias.gyro;
  if (settled_ && !absurd) {
    std::vector<LineId> all;
    for (const auto& [id, at] : prior_.lines()) all.push_back(id);
    archive(prior_.reduced({}), all);
  }
  states_.back() = now;
  first_ = begun_ = states_.size() - 1;
  for (auto& [id, track] : tracks_) release(track);
  std::erase_if(tracks_, [](const auto& entry) { return !entry.second.archived; });
  for (auto& [id, track] : tracks_) {
    track.seen.clear();
    track.tie.reset();
  }
  alias_.clear();
  proposed_.clear();
  set_prior(now, false, map_.size() > 0 ? kPosition : options_.start_pose_sigma,
            map_.size() > 0 ? kYaw : options_.start_pose_sigma);
  gauge_ = prior_;
  covariance_.reset();
  settled_ = false;
  drop_past();
}

// Little motion can be explained by a scene and by its reversal in depth, with the motion reversed and the
// biases wrong, and the optimum next to a poor first guess may be a poor one. Until the velocity is known the
// problem is therefore solved from other points too now and then, and goes on from where the cost is least.
SolveStats FixedLag::try_other_starts(SolveStats stats, const std::vector<LineId>& ids,
                                      const ActivePrior& prior) {
  constexpr std::size_t kEvery = 4;  // windows
  constexpr double kBetter = 0.99;   // share of the cost
  if ((states_.size() - begun_) % kEvery != 0 || std::ssize(ids) < options_.few_lines / 2) return stats;
  Variables best = variables(ids);
  std::optional<StateMat> best_covariance = covariance_;
  const auto attempt = [&] {
    const SolveStats other = optimise(ids, prior, kIterationsToSettle, kEnoughToSettle);
    stats.iterations += other.iterations;
    if (other.cost < kBetter * stats.cost) {
      stats.cost = other.cost;
      best = variables(ids);
      best_covariance = covariance_;
    }
    set_variables(best, ids);
    covariance_ = best_covariance;
  };
  // All depths alike, and the motion by the IMU from the start's state.
  states_[first_] = prior.prior.state();
  for (std::size_t w = first_; w < windows_.size(); ++w) predict_end(w);
  move_cameras();
  for (const LineId id : ids) {
    Track& track = tracks_.at(id);
    track.line = new_line(track, typical_depth());
  }
  attempt();
  // Reversed.
  std::vector<double> inverse_depths;
  for (const LineId id : ids) inverse_depths.push_back(tracks_.at(id).line.coordinates[1]);
  const double middle = percentile(inverse_depths, 0.5);
  for (const LineId id : ids)
    for (const int k : {1, 3}) {
      double& inverse_depth = tracks_.at(id).line.coordinates[k];
      inverse_depth = std::clamp(2 * middle - inverse_depth, 0.3 * middle, 3 * middle);
    }
  const Vec3 from = states_[first_].T_w_i.p;
  for (std::size_t w = first_; w < states_.size(); ++w) {
    states_[w].T_w_i.p = 2 * from - states_[w].T_w_i.p;
    states_[w].v_w *= -1;
  }
  move_cameras();
  attempt();
  return stats;
}

}  // namespace idol
