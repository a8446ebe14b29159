// The least-squares problem of the fixed lag: linearisation, marginal prior, steps.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"

namespace idol {
namespace {

constexpr double kShiftWalk = 1e-5;  // of the camera's clock against the IMU's [s/sqrt(s)]
constexpr double kLagWalk = 0.003;   // of the events' lag: light and contrasts change [px/sqrt(s)]

// Change from `from` to `to`, in our tangent order [p, theta, v, b_g, b_a, time shift, event lag].
StateVec difference(const NavState& from, const NavState& to) {
  StateVec d;
  d << to.T_w_i.p - from.T_w_i.p, quat_log(from.T_w_i.q.conjugate() * to.T_w_i.q), to.v_w - from.v_w,
      to.bias.gyro - from.bias.gyro, to.bias.accel - from.bias.accel, to.time_shift - from.time_shift,
      to.event_lag_px - from.event_lag_px;
  return d;
}

// Of the rotation part of `difference` to a change of `to`.
Mat3 to_turn(const NavState& from, const NavState& to) {
  return right_jacobian_inverse(quat_log(from.T_w_i.q.conjugate() * to.T_w_i.q));
}

void move(NavState& state, const StateVec& step) {
  state.T_w_i.p += step.head<3>();
  state.T_w_i.q = (state.T_w_i.q * quat_exp(step.segment<3>(3))).normalized();
  state.v_w += step.segment<3>(6);
  state.bias.gyro += step.segment<3>(9);
  state.bias.accel += step.segment<3>(12);
  state.time_shift += step[15];
  state.event_lag_px += step[16];
}

using WorldMoves = Eigen::Matrix<double, Eigen::Dynamic, 4>;

// Columns: how a state changes when the world is shifted along its x, y, z or turned about its z axis.
Eigen::Matrix<double, kStateDim, 4> world_moves(const NavState& state) {
  Eigen::Matrix<double, kStateDim, 4> out = Eigen::Matrix<double, kStateDim, 4>::Zero();
  out.topLeftCorner<3, 3>().setIdentity();
  out.col(3).head<3>() = Vec3::UnitZ().cross(state.T_w_i.p);
  out.col(3).segment<3>(3) = state.T_w_i.q.conjugate() * Vec3::UnitZ();
  out.col(3).segment<3>(6) = Vec3::UnitZ().cross(state.v_w);
  return out;
}

Eigen::Index column_of(const std::vector<LineId>& ids, LineId id) {
  return 4 * (std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
}

}  // namespace

// Shifting the whole world or turning it about the vertical changes no measurement. The prior was linearised
// elsewhere, where other changes of the variables were such moves (N_0): taken as it is, it would hold down
// the present ones (N), which nothing has measured. What it knows is where the lines are, seen from its
// state; so the part of a change that is a move with the state counts as the same move there: d + (N_0 - N)
// m(d), where m(d) are shift and turn of the state in d. These are the columns of that map for the state;
// those of the lines are the identity. What the start says about position and yaw stays.
FixedLag::StateColumns FixedLag::prior_view(const Prior& prior) const {
  const Eigen::Index n = prior.g.size();
  WorldMoves here(n, 4), there(n, 4);
  const Mat3 turn = to_turn(prior.state, states_[first_]);
  here.topRows<kStateDim>() = world_moves(states_[first_]);
  here.block<3, 1>(3, 3) = turn * here.block<3, 1>(3, 3);
  there.topRows<kStateDim>() = world_moves(prior.state);
  for (std::size_t k = 0; k < prior.lines.size(); ++k) {
    const Eigen::Index row = kStateDim + 4 * static_cast<Eigen::Index>(k);
    AnchoredLine line = tracks_.at(prior.lines[k].first).line;
    here.middleRows<4>(row) = line.world_moves();
    line.coordinates = prior.lines[k].second;
    there.middleRows<4>(row) = line.world_moves();
  }
  // The move that takes the present state along.
  Eigen::Matrix<double, 4, kStateDim> move = Eigen::Matrix<double, 4, kStateDim>::Zero();
  move.topLeftCorner<3, 3>().setIdentity();
  const RowVec3 yaw = here.block<3, 1>(3, 3).transpose() / here.block<3, 1>(3, 3).squaredNorm();
  move.block<1, 3>(3, 3) = yaw;
  move.block<3, 3>(0, 3) = -here.col(3).head<3>() * yaw;
  StateColumns T = (there - here) * move;
  T.topRows<kStateDim>() += StateMat::Identity();
  return T;
}

void FixedLag::add_prior(ChainSystem& system, const Prior& prior, const std::vector<LineId>& ids) const {
  const Eigen::Index n = prior.g.size();
  Eigen::VectorXd d(n);
  d.head<kStateDim>() = difference(prior.state, states_[first_]);
  for (std::size_t k = 0; k < prior.lines.size(); ++k)
    d.segment<4>(kStateDim + 4 * static_cast<Eigen::Index>(k)) =
        tracks_.at(prior.lines[k].first).line.coordinates - prior.lines[k].second;
  StateColumns T = prior_view(prior);
  Eigen::VectorXd seen = T * d.head<kStateDim>();
  seen.tail(n - kStateDim) += d.tail(n - kStateDim);
  T.middleCols<3>(3) = (T.middleCols<3>(3) * to_turn(prior.state, states_[first_])).eval();
  const Eigen::VectorXd g = prior.g + prior.H * seen;
  const StateColumns HT = prior.H * T;
  system.cost += 0.5 * seen.dot(prior.g + g);

  system.diagonal[0] += T.transpose() * HT;
  system.state_gradient[0] += T.transpose() * g;
  for (std::size_t k = 0; k < prior.lines.size(); ++k) {
    const Eigen::Index row = kStateDim + 4 * static_cast<Eigen::Index>(k),
                       column = column_of(ids, prior.lines[k].first);
    system.lines[0].middleCols<4>(column) += HT.middleRows<4>(row).transpose();
    system.line_gradient.segment<4>(column) += g.segment<4>(row);
    for (std::size_t j = 0; j < prior.lines.size(); ++j)
      system.line_block.block<4, 4>(column, column_of(ids, prior.lines[j].first)) +=
          prior.H.block<4, 4>(row, kStateDim + 4 * static_cast<Eigen::Index>(j));
  }
}

BinResidual FixedLag::residual(const LineBin& bin, const AnchoredLine& line, std::size_t window) const {
  return bin_to_line(bin, states_[window].event_lag_px, line,
                     inertial_[window].cameras[static_cast<std::size_t>(bin.slot)], projection_.camera);
}

// After each change of the active states.
void FixedLag::move_cameras() {
  for (std::size_t w = first_; w < windows_.size(); ++w) {
    inertial_[w].cameras.clear();
    for (const Preintegrated& motion : inertial_[w].bins)
      inertial_[w].cameras.emplace_back(states_[w], later(motion, states_[w].time_shift),
                                        windows_[w].imu->bias(), projection_);
  }
}

// IMU, bias walk and rest between the states at `slot` and `slot + 1`.
void FixedLag::add_window(ChainSystem& system, std::size_t window, std::size_t slot) const {
  const NavState &from = states_[window], &to = states_[window + 1];
  const Inertial& inertial = inertial_[window];
  const ImuResidual r =
      imu_residual(from, to, inertial.motion, windows_[window].imu->bias(), projection_.gravity);
  const Eigen::Matrix<double, 15, 9> from_w = r.d_from.transpose() * inertial.weight;
  const Eigen::Matrix<double, 15, 9> to_w = r.d_to.transpose() * inertial.weight;
  system.cost += 0.5 * r.value.dot(inertial.weight * r.value);
  system.diagonal[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_from;
  system.next[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_to;
  system.diagonal[slot + 1].topLeftCorner<15, 15>().noalias() += to_w * r.d_to;
  system.state_gradient[slot].head<15>().noalias() += from_w * r.value;
  system.state_gradient[slot + 1].head<15>().noalias() += to_w * r.value;

  // Biases, time shift and lag hardly change.
  Eigen::Matrix<double, 8, 1> weight;
  weight << Vec3::Constant(1 / (noise_.gyro_walk * noise_.gyro_walk * inertial.motion.dt)),
      Vec3::Constant(1 / (noise_.accel_walk * noise_.accel_walk * inertial.motion.dt)),
      1 / (kShiftWalk * kShiftWalk * inertial.motion.dt), 1 / (kLagWalk * kLagWalk * inertial.motion.dt);
  Eigen::Matrix<double, 8, 1> walk;
  walk << bias_residual(from.bias, to.bias), to.time_shift - from.time_shift,
      to.event_lag_px - from.event_lag_px;
  system.cost += 0.5 * walk.dot(weight.cwiseProduct(walk));
  system.diagonal[slot].bottomRightCorner<8, 8>().diagonal() += weight;
  system.diagonal[slot + 1].bottomRightCorner<8, 8>().diagonal() += weight;
  system.next[slot].bottomRightCorner<8, 8>().diagonal() -= weight;
  system.state_gradient[slot].tail<8>() -= weight.cwiseProduct(walk);
  system.state_gradient[slot + 1].tail<8>() += weight.cwiseProduct(walk);

  if (windows_[window].still) {
    const double rest = 1 / std::pow(options_.start_velocity_sigma, 2);
    system.cost += 0.5 * rest * from.v_w.squaredNorm();
    system.diagonal[slot].block<3, 3>(6, 6).diagonal().array() += rest;
    system.state_gradient[slot].segment<3>(6) += rest * from.v_w;
  }
}

double FixedLag::sigma_px(const LineBin& bin) const {
  return options_.bin_sigma_px * std::sqrt(1 + 1.0 / std::max(1, bin.count));
}

// Cauchy's loss on both rows of a bin together.
void FixedLag::add_observation(ChainSystem& system, const Track& track, const Observation& seen,
                               std::size_t slot, Eigen::Index column) const {
  const double scale = options_.bin_cauchy_sigmas * options_.bin_cauchy_sigmas;
  for (const LineBin& bin : seen.bins) {
    const BinResidual r = residual(bin, track.line, seen.window);
    if (!r.valid) continue;
    const double information = 1 / std::pow(sigma_px(bin), 2);
    const double squared = r.value.squaredNorm() * information;
    const double weight = information / (1 + squared / scale);
    system.cost += 0.5 * scale * std::log1p(squared / scale);
    const Eigen::Matrix<double, kStateDim, 2> state_w = weight * r.d_state.transpose();
    const Eigen::Matrix<double, 4, 2> line_w = weight * r.d_line.transpose();
    system.diagonal[slot].noalias() += state_w * r.d_state;
    system.lines[slot].middleCols<4>(column).noalias() += state_w * r.d_line;
    system.line_block.block<4, 4>(column, column).noalias() += line_w * r.d_line;
    system.state_gradient[slot].noalias() += state_w * r.value;
    system.line_gradient.segment<4>(column).noalias() += line_w * r.value;
  }
}

ChainSystem FixedLag::linearise(const std::vector<LineId>& ids, const Prior& prior) const {
  ChainSystem system(states_.size() - first_, 4 * std::ssize(ids));
  add_prior(system, prior, ids);
  for (std::size_t w = first_; w < windows_.size(); ++w) add_window(system, w, w - first_);
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    for (const auto& seen : track.seen)
      if (!seen.rejected) add_observation(system, track, seen, seen.window - first_, column_of(ids, id));
  }
  return system;
}

// The prior over the oldest state and the lines in `ids`, the others eliminated.
FixedLag::Prior FixedLag::reduced_prior(const std::vector<LineId>& ids) const {
  Prior out;
  out.state = prior_.state;
  std::vector<Eigen::Index> order, rest;
  for (Eigen::Index i = 0; i < kStateDim; ++i) order.push_back(i);
  for (std::size_t k = 0; k < prior_.lines.size(); ++k) {
    const bool keep = std::binary_search(ids.begin(), ids.end(), prior_.lines[k].first);
    if (keep) out.lines.push_back(prior_.lines[k]);
    for (Eigen::Index i = 0; i < 4; ++i)
      (keep ? order : rest).push_back(kStateDim + 4 * static_cast<Eigen::Index>(k) + i);
  }
  order.insert(order.end(), rest.begin(), rest.end());
  out.H = prior_.H(order, order);
  out.g = prior_.g(order);
  eliminate_last(out.H, out.g, std::ssize(rest));
  return out;
}

// Lines that only the prior knows follow the rest of it: d_r = -H_rr^-1 (g_r + H_ra d_a).
void FixedLag::update_resting_lines(const std::vector<LineId>& ids) {
  std::vector<Eigen::Index> known, rest;
  std::vector<double> moved;
  const StateVec d_state = difference(prior_.state, states_[first_]);
  for (Eigen::Index i = 0; i < kStateDim; ++i) {
    known.push_back(i);
    moved.push_back(d_state[i]);
  }
  std::vector<std::size_t> resting;
  for (std::size_t k = 0; k < prior_.lines.size(); ++k) {
    const bool active = std::binary_search(ids.begin(), ids.end(), prior_.lines[k].first);
    if (!active) resting.push_back(k);
    for (Eigen::Index i = 0; i < 4; ++i) {
      (active ? known : rest).push_back(kStateDim + 4 * static_cast<Eigen::Index>(k) + i);
      if (active)
        moved.push_back((tracks_.at(prior_.lines[k].first).line.coordinates - prior_.lines[k].second)[i]);
    }
  }
  if (resting.empty()) return;
  const Eigen::Map<Eigen::VectorXd> d(moved.data(), std::ssize(moved));
  const Eigen::MatrixXd H = prior_.H(rest, rest);
  const Eigen::VectorXd g = prior_.g(rest) + prior_.H(rest, known) * d;
  const Eigen::LDLT<Eigen::MatrixXd> factor(H);
  const Eigen::VectorXd step = factor.solve(-g);
  if (!step.allFinite()) return;
  for (std::size_t k = 0; k < resting.size(); ++k) {
    const auto& [id, at] = prior_.lines[resting[k]];
    tracks_.at(id).line.coordinates = at + step.segment<4>(4 * static_cast<Eigen::Index>(k));
  }
}

void FixedLag::apply(const ChainSystem::Step& step, const std::vector<LineId>& ids) {
  for (std::size_t i = 0; i < step.states.size(); ++i) move(states_[first_ + i], step.states[i]);
  move_cameras();
  for (std::size_t k = 0; k < ids.size(); ++k)
    tracks_.at(ids[k]).line.move(step.lines.segment<4>(4 * static_cast<Eigen::Index>(k)));
}

// The oldest state and all that was seen from it become part of the prior.
void FixedLag::marginalise_oldest() {
  std::vector<LineId> ids;
  for (const auto& [id, at] : prior_.lines) ids.push_back(id);
  for (auto& [id, track] : tracks_)
    if (track.mapped && !track.dead &&
        std::any_of(track.seen.begin(), track.seen.end(),
                    [&](const Observation& o) { return o.window == first_ && !o.rejected; }))
      ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());

  ChainSystem system(2, 4 * std::ssize(ids));
  add_prior(system, prior_, ids);
  add_window(system, first_, 0);
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    for (const auto& seen : track.seen)
      if (seen.window == first_ && !seen.rejected)
        add_observation(system, track, seen, 0, column_of(ids, id));
  }
  system.eliminate_first(prior_.H, prior_.g);
  ++first_;
  prior_.state = states_[first_];
  prior_.lines.clear();
  for (LineId id : ids) prior_.lines.emplace_back(id, tracks_.at(id).line.coordinates);
  for (auto& [id, track] : tracks_) {
    // In the order of windows; pieces of a line give it several observations in one.
    const auto active = std::find_if(track.seen.begin(), track.seen.end(),
                                     [&](const Observation& o) { return o.window >= first_; });
    std::move(track.seen.begin(), active, std::back_inserter(track.past));
    track.seen.erase(track.seen.begin(), active);
  }
  if (!keeps_past()) drop_past();
}

// Only the states stay: memory does not grow with what was seen.
void FixedLag::drop_past() {
  for (auto& [id, track] : tracks_) track.past = {};
  for (; dropped_ < first_; ++dropped_) {
    windows_[dropped_].imu.reset();
    inertial_[dropped_].bins = {};
    inertial_[dropped_].cameras = {};
  }
}

// Dead lines leave the prior, and the longest unseen ones beyond the number that is kept.
void FixedLag::forget() {
  std::vector<std::pair<std::size_t, LineId>> resting;  // by when they were last seen
  for (const auto& [id, at] : prior_.lines)
    if (tracks_.at(id).seen.empty()) resting.emplace_back(tracks_.at(id).last_window, id);
  std::sort(resting.begin(), resting.end());
  const auto keep = static_cast<std::size_t>(options_.max_resting_lines);
  std::vector<LineId> old;
  for (std::size_t k = 0; k + keep < resting.size(); ++k) old.push_back(resting[k].second);
  std::vector<LineId> kept;
  for (const auto& [id, at] : prior_.lines)
    if (!tracks_.at(id).dead && std::find(old.begin(), old.end(), id) == old.end()) kept.push_back(id);
  if (kept.size() == prior_.lines.size()) return;
  std::sort(kept.begin(), kept.end());
  prior_ = reduced_prior(kept);
}

}  // namespace idol
