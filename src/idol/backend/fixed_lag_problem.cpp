// The least-squares problem of the fixed lag: linearisation and steps.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"

namespace idol {
namespace {

constexpr double kShiftWalk = 1e-5;  // of the camera's clock against the IMU's [s/sqrt(s)]
constexpr double kLagWalk = 0.003;   // of the events' lag: light and contrasts change [px/sqrt(s)]
constexpr double kRestRate = 0.01;   // turning at rest, anew in each window [rad/s]

void move(NavState& state, const StateVec& step) {
  state.T_w_i.p += step.head<3>();
  state.T_w_i.q = (state.T_w_i.q * quat_exp(step.segment<3>(3))).normalized();
  state.v_w += step.segment<3>(6);
  state.bias.gyro += step.segment<3>(9);
  state.bias.accel += step.segment<3>(12);
  state.time_shift += step[15];
  state.event_lag_px += step[16];
}

}  // namespace

// The calibration, if it is refined, comes before the lines.
Eigen::Index FixedLag::column_of(const std::vector<LineId>& ids, LineId id) const {
  return calibration_dim_ + 4 * (std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
}

BinResidual FixedLag::residual(const LineBin& bin, const AnchoredLine& line, std::size_t window) const {
  return bin_to_line(bin, states_[window].event_lag_px, line,
                     inertial_[window]->cameras[static_cast<std::size_t>(bin.slot)], projection_.camera);
}

std::optional<Vec2> FixedLag::distances(const LineBin& bin, const AnchoredLine& line,
                                        std::size_t window) const {
  return bin_distances(bin, states_[window].event_lag_px, line,
                       inertial_[window]->cameras[static_cast<std::size_t>(bin.slot)], projection_.camera);
}

// After each change of the active states or of the calibration.
void FixedLag::move_cameras() {
  if (camera_dim_ > 0) {
    projection_.T_i_c.q = (nominal_.T_i_c.q * quat_exp(calibration_.head<3>())).normalized();
    projection_.camera.fx = nominal_.camera.fx * std::exp(calibration_[3]);
    projection_.camera.fy = nominal_.camera.fy * std::exp(calibration_[3]);
  }
  for (std::size_t w = first_; w < windows_.size(); ++w) {
    Inertial& inertial = *inertial_[w];
    windows_[w].bias = inertial.linearised_at;
    if (imu_dim_ > 0) {  // what acts beside the state's biases, on the other side of their difference
      const Eigen::Matrix<double, 6, 1> more =
          inertial.by_intrinsics * calibration_.tail<kImuIntrinsicsDim>();
      windows_[w].bias.gyro -= more.head<3>();
      windows_[w].bias.accel -= more.tail<3>();
    }
    inertial.cameras.clear();
    for (const Preintegrated& motion : inertial.bins)
      inertial.cameras.emplace_back(states_[w], later(motion, states_[w].time_shift), windows_[w].bias,
                                    projection_);
  }
}

FixedLag::Variables FixedLag::variables(const std::vector<LineId>& ids) const {
  Variables out{{states_.begin() + static_cast<std::ptrdiff_t>(first_), states_.end()}, calibration_, {}};
  for (const LineId id : ids) out.lines.push_back(tracks_.at(id).line);
  return out;
}

void FixedLag::set_variables(const Variables& to, const std::vector<LineId>& ids) {
  std::copy(to.states.begin(), to.states.end(), states_.begin() + static_cast<std::ptrdiff_t>(first_));
  calibration_ = to.calibration;
  for (std::size_t k = 0; k < ids.size(); ++k) tracks_.at(ids[k]).line = to.lines[k];
  move_cameras();
}

// The state at a window's end, from that at its begin.
void FixedLag::predict_end(std::size_t window) {
  NavState& end = states_[window + 1];
  const Time t = end.t;
  end = predict(states_[window], inertial_[window]->motion, windows_[window].bias, projection_.gravity);
  end.t = t;
}

FixedLag::WindowRows FixedLag::window_rows(std::size_t window) const {
  const NavState &from = states_[window], &to = states_[window + 1];
  const Inertial& inertial = *inertial_[window];
  WindowRows out;
  out.imu = imu_residual(from, to, inertial.motion, windows_[window].bias, projection_.gravity);
  const double dt = inertial.motion.dt;
  out.walk_weight << Vec3::Constant(1 / (noise_.gyro_walk * noise_.gyro_walk * dt)),
      Vec3::Constant(1 / (noise_.accel_walk * noise_.accel_walk * dt)), 1 / (kShiftWalk * kShiftWalk * dt),
      1 / (kLagWalk * kLagWalk * dt);
  out.walk << bias_residual(from.bias, to.bias), to.time_shift - from.time_shift,
      to.event_lag_px - from.event_lag_px;
  if (windows_[window].still) {
    out.rest_weight = 1 / std::pow(options_.start_velocity_sigma, 2);
    out.rest_turn_weight = 1 / std::pow(kRestRate * dt, 2);
    out.turn = quat_log(from.T_w_i.q.conjugate() * to.T_w_i.q);
  }
  out.cost = 0.5 * (out.imu.value.dot(inertial.weight * out.imu.value) +
                    out.walk.dot(out.walk_weight.cwiseProduct(out.walk)) +
                    out.rest_weight * from.v_w.squaredNorm() + out.rest_turn_weight * out.turn.squaredNorm());
  return out;
}

// IMU, bias walk and rest between the states at `slot` and `slot + 1`.
void FixedLag::add_window(ChainSystem& system, std::size_t window, std::size_t slot) const {
  const WindowRows rows = window_rows(window);
  const ImuResidual& r = rows.imu;
  const Eigen::Matrix<double, 15, 9> from_w = r.d_from.transpose() * inertial_[window]->weight;
  const Eigen::Matrix<double, 15, 9> to_w = r.d_to.transpose() * inertial_[window]->weight;
  system.cost += rows.cost;
  system.diagonal[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_from;
  system.next[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_to;
  system.diagonal[slot + 1].topLeftCorner<15, 15>().noalias() += to_w * r.d_to;
  system.state_gradient[slot].head<15>().noalias() += from_w * r.value;
  system.state_gradient[slot + 1].head<15>().noalias() += to_w * r.value;

  if (imu_dim_ > 0) {
    const Eigen::Matrix<double, 9, kImuIntrinsicsDim> by_imu =
        r.d_from.middleCols<6>(9) * inertial_[window]->by_intrinsics;
    Eigen::Matrix<double, kStateDim, kImuIntrinsicsDim>
        from = Eigen::Matrix<double, kStateDim, kImuIntrinsicsDim>::Zero(),
        to = from;
    from.topRows<15>() = from_w * by_imu;
    to.topRows<15>() = to_w * by_imu;
    const Eigen::Matrix<double, kImuIntrinsicsDim, 9> weighted =
        by_imu.transpose() * inertial_[window]->weight;
    add_imu_columns(system, slot, from, weighted * by_imu);
    add_imu_columns(system, slot + 1, to,
                    Eigen::Matrix<double, kImuIntrinsicsDim, kImuIntrinsicsDim>::Zero());
    system.line_gradient.segment<kImuIntrinsicsDim>(camera_dim_) += weighted * r.value;
  }

  // Biases, time shift and lag hardly change.
  const auto& weight = rows.walk_weight;
  system.diagonal[slot].bottomRightCorner<8, 8>().diagonal() += weight;
  system.diagonal[slot + 1].bottomRightCorner<8, 8>().diagonal() += weight;
  system.next[slot].bottomRightCorner<8, 8>().diagonal() -= weight;
  system.state_gradient[slot].tail<8>() -= weight.cwiseProduct(rows.walk);
  system.state_gradient[slot + 1].tail<8>() += weight.cwiseProduct(rows.walk);

  system.diagonal[slot].block<3, 3>(6, 6).diagonal().array() += rows.rest_weight;
  system.state_gradient[slot].segment<3>(6) += rows.rest_weight * states_[window].v_w;
  if (rows.rest_turn_weight == 0) return;
  const Mat3 to = right_jacobian_inverse(rows.turn), from = -to.transpose();
  const double w = rows.rest_turn_weight;
  system.diagonal[slot].block<3, 3>(3, 3) += w * from.transpose() * from;
  system.next[slot].block<3, 3>(3, 3) += w * from.transpose() * to;
  system.diagonal[slot + 1].block<3, 3>(3, 3) += w * to.transpose() * to;
  system.state_gradient[slot].segment<3>(3) += w * from.transpose() * rows.turn;
  system.state_gradient[slot + 1].segment<3>(3) += w * to.transpose() * rows.turn;
}

// The mean of a thin edge's events is off by bin_sigma_px, whatever their number; that of a thick one by
// more.
double FixedLag::widening(const LineBin& bin) {
  constexpr double kThin = 0.6;  // [px]
  return std::max(1.0, bin.scatter_px / kThin);
}

double FixedLag::sigma_px(const LineBin& bin) const {
  return options_.bin_sigma_px * widening(bin) * std::sqrt(1 + 1.0 / std::max(1, bin.count));
}

// Cauchy's loss on both rows of a bin together: cost, and the weight of the rows' squares.
std::pair<double, double> FixedLag::robust(const LineBin& bin, const Vec2& distances) const {
  const double scale = options_.bin_cauchy_sigmas * options_.bin_cauchy_sigmas;
  const double information = 1 / std::pow(sigma_px(bin), 2);
  const double squared = distances.squaredNorm() * information;
  return {0.5 * scale * std::log1p(squared / scale), information / (1 + squared / scale)};
}

void FixedLag::add_observation(ChainSystem& system, std::vector<SightSystem>& sights, const Track& track,
                               const Observation& seen, std::size_t slot, Eigen::Index column) const {
  // Before the reference below: they may move it.
  for (Eigen::Index k = 0; k < calibration_dim_; k += 4) system.lines[slot].at(k);
  LineBlocks::Block& to_line = system.lines[slot].at(column);
  for (const LineBin& bin : seen.bins) {
    const BinResidual r = residual(bin, track.line, seen.window);
    if (!r.valid) continue;
    const auto [cost, weight] = robust(bin, r.value);
    SightSystem& sight = sights[static_cast<std::size_t>(bin.slot)];
    const Eigen::Matrix<double, 2, 7> camera_w = weight * r.d_camera;
    const Eigen::Matrix<double, 2, 4> line_w = weight * r.d_line;
    const Eigen::Matrix<double, 2, kStateDim> d_state = r.d_camera * sight.by_state;
    system.cost += cost;
    sight.H.noalias() += camera_w.transpose() * r.d_camera;
    sight.g.noalias() += camera_w.transpose() * r.value;
    to_line.noalias() += d_state.transpose() * line_w;
    system.line_block.block<4, 4>(column, column).noalias() += line_w.transpose() * r.d_line;
    system.line_gradient.segment<4>(column).noalias() += line_w.transpose() * r.value;
    if (imu_dim_ > 0) {
      const Eigen::Matrix<double, kImuIntrinsicsDim, 4> both =
          sight.by_imu.transpose() * (camera_w.transpose() * r.d_line);
      system.line_block.block<kImuIntrinsicsDim, 4>(camera_dim_, column) += both;
      system.line_block.block<4, kImuIntrinsicsDim>(column, camera_dim_) += both.transpose();
    }
    if (camera_dim_ == 0) continue;
    const Eigen::Matrix<double, 2, 4> calibration_w = weight * r.d_calibration;
    sight.by_camera.noalias() += r.d_camera.transpose() * calibration_w;
    system.line_block.topLeftCorner<4, 4>().noalias() += calibration_w.transpose() * r.d_calibration;
    const Eigen::Matrix4d both = calibration_w.transpose() * r.d_line;
    system.line_block.block<4, 4>(0, column) += both;
    system.line_block.block<4, 4>(column, 0) += both.transpose();
    system.line_gradient.head<4>().noalias() += calibration_w.transpose() * r.value;
  }
}

// What lines say about the state of a window meets first in the cameras of its bins.
std::vector<FixedLag::SightSystem> FixedLag::sight_systems(std::size_t window) const {
  std::vector<SightSystem> out(inertial_[window]->cameras.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].by_state.topLeftCorner<6, 16>() = inertial_[window]->cameras[k].by_state();
    out[k].by_state(6, 16) = 1;
    out[k].by_imu = out[k].by_state.middleCols<6>(9) * inertial_[window]->by_intrinsics;
  }
  return out;
}

void FixedLag::add_sights(ChainSystem& system, const std::vector<SightSystem>& sights,
                          std::size_t slot) const {
  using ByImu = Eigen::Matrix<double, 7, kImuIntrinsicsDim>;
  for (const SightSystem& sight : sights) {
    const Eigen::Matrix<double, 7, kStateDim> H = sight.H * sight.by_state;
    system.diagonal[slot].noalias() += sight.by_state.transpose() * H;
    system.state_gradient[slot].noalias() += sight.by_state.transpose() * sight.g;
    if (camera_dim_ > 0) system.lines[slot].at(0).noalias() += sight.by_state.transpose() * sight.by_camera;
    if (imu_dim_ == 0) continue;
    const ByImu H_imu = sight.H * sight.by_imu;
    add_imu_columns(system, slot, sight.by_state.transpose() * H_imu, sight.by_imu.transpose() * H_imu);
    system.line_gradient.segment<kImuIntrinsicsDim>(camera_dim_) += sight.by_imu.transpose() * sight.g;
    if (camera_dim_ == 0) continue;
    const Eigen::Matrix<double, kImuIntrinsicsDim, 4> both = sight.by_imu.transpose() * sight.by_camera;
    system.line_block.block<kImuIntrinsicsDim, 4>(camera_dim_, 0) += both;
    system.line_block.block<4, kImuIntrinsicsDim>(0, camera_dim_) += both.transpose();
  }
}

void FixedLag::add_imu_columns(
    ChainSystem& system, std::size_t slot,
    const Eigen::Matrix<double, kStateDim, kImuIntrinsicsDim>& by_state,
    const Eigen::Matrix<double, kImuIntrinsicsDim, kImuIntrinsicsDim>& by_imu) const {
  for (Eigen::Index k = 0; k < kImuIntrinsicsDim; k += 4)
    system.lines[slot].at(camera_dim_ + k) += by_state.middleCols<4>(k);
  system.line_block.block<kImuIntrinsicsDim, kImuIntrinsicsDim>(camera_dim_, camera_dim_) += by_imu;
}

ChainSystem FixedLag::linearise(const std::vector<LineId>& ids, const ActivePrior& prior) const {
  ChainSystem system(states_.size() - first_, calibration_dim_ + 4 * std::ssize(ids));
  add_prior(system, prior, ids);
  std::vector<std::vector<SightSystem>> sights;
  for (std::size_t w = first_; w < windows_.size(); ++w) {
    add_window(system, w, w - first_);
    sights.push_back(sight_systems(w));
  }
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    const Eigen::Index column = column_of(ids, id);
    for (const auto& seen : track.seen) {
      const std::size_t slot = seen.window - first_;
      if (!seen.rejected) add_observation(system, sights[slot], track, seen, slot, column);
    }
  }
  for (std::size_t slot = 0; slot < sights.size(); ++slot) add_sights(system, sights[slot], slot);
  add_line_factors(system, ids);
  return system;
}

double FixedLag::cost(const std::vector<LineId>& ids, const ActivePrior& prior) const {
  double sum = with_prior_variables([&](const PriorVariables& now) { return prior.prior.cost(now); });
  for (std::size_t w = first_; w < windows_.size(); ++w) sum += window_rows(w).cost;
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    if (track.tie && !track.tie->in_prior) sum += robust(track.tie->residual(track.line)).first;
    if (track.depth_prior) sum += 0.5 * track.depth_prior->residual(track.line).squaredNorm();
    for (const auto& seen : track.seen) {
      if (seen.rejected) continue;
      for (const LineBin& bin : seen.bins)
        if (const auto d = distances(bin, track.line, seen.window)) sum += robust(bin, *d).first;
    }
  }
  return sum;
}

void FixedLag::apply(const ChainSystem::Step& step, const std::vector<LineId>& ids) {
  for (std::size_t i = 0; i < step.states.size(); ++i) move(states_[first_ + i], step.states[i]);
  calibration_ += step.lines.head(calibration_dim_);
  move_cameras();
  for (LineId id : ids) tracks_.at(id).line.move(step.lines.segment<4>(column_of(ids, id)));
}

}  // namespace idol
