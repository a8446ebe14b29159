// The least-squares problem of the fixed lag: linearisation, marginal prior, steps.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"

namespace idol {
namespace {

constexpr double kShiftWalk = 1e-5;  // of the camera's clock against the IMU's [s/sqrt(s)]
constexpr double kLagWalk = 0.003;   // of the events' lag: light and contrasts change [px/sqrt(s)]
constexpr double kRestRate = 0.01;   // turning at rest, anew in each window [rad/s]

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

}  // namespace

// The calibration, if it is refined, comes before the lines.
Eigen::Index FixedLag::column_of(const std::vector<LineId>& ids, LineId id) const {
  return calibration_dim_ + 4 * (std::lower_bound(ids.begin(), ids.end(), id) - ids.begin());
}

// Shifting the whole world or turning it about the vertical changes no measurement. The prior was linearised
// elsewhere, where other changes of the variables were such moves (N_0): taken as it is, it would hold down
// the present ones (N), which nothing has measured. What it knows is where the lines are, seen from its
// state; so the part of a change that is a move with the state counts as the same move there: d + (N_0 - N)
// m(d), where m(d) are shift and turn of the state in d. These are the columns of that map for the state;
// those of the lines are the identity. What the start says about position and yaw stays.
FixedLag::StateColumns FixedLag::prior_view(const Prior& prior) const {
  const Eigen::Index n = prior.g.size();
  WorldMoves here = WorldMoves::Zero(n, 4), there = WorldMoves::Zero(n, 4);
  const Mat3 turn = to_turn(prior.state, states_[first_]);
  here.topRows<kStateDim>() = world_moves(states_[first_]);
  here.block<3, 1>(3, 3) = turn * here.block<3, 1>(3, 3);
  there.topRows<kStateDim>() = world_moves(prior.state);
  for (std::size_t k = 0; k < prior.lines.size(); ++k) {
    const Eigen::Index row = prior_row(k);
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

// From where the prior was taken to the present.
Eigen::VectorXd FixedLag::change_since(const Prior& prior) const {
  Eigen::VectorXd d(prior.g.size());
  d.head<kStateDim>() = difference(prior.state, states_[first_]);
  d.segment(kStateDim, calibration_dim_) = (calibration_ - prior.calibration).head(calibration_dim_);
  for (std::size_t k = 0; k < prior.lines.size(); ++k)
    d.segment<4>(prior_row(k)) = tracks_.at(prior.lines[k].first).line.coordinates - prior.lines[k].second;
  return d;
}

// The same with the moves of the world as prior_view() sees them.
Eigen::VectorXd FixedLag::seen_change(const Prior& prior, const StateColumns& view) const {
  Eigen::VectorXd d = change_since(prior);
  const StateVec state = d.head<kStateDim>();
  d.head<kStateDim>().setZero();
  return d + view * state;
}

double FixedLag::prior_cost(const Prior& prior) const {
  const Eigen::VectorXd d = seen_change(prior, prior_view(prior));
  return d.dot(prior.g + 0.5 * (prior.H * d));
}

void FixedLag::add_prior(ChainSystem& system, const Prior& prior, const std::vector<LineId>& ids) const {
  StateColumns T = prior_view(prior);
  const Eigen::VectorXd d = seen_change(prior, T);
  T.middleCols<3>(3) = (T.middleCols<3>(3) * to_turn(prior.state, states_[first_])).eval();
  const Eigen::VectorXd g = prior.g + prior.H * d;
  const StateColumns HT = prior.H * T;
  system.cost += 0.5 * d.dot(prior.g + g);

  system.diagonal[0] += T.transpose() * HT;
  system.state_gradient[0] += T.transpose() * g;
  // Where a variable of the prior stands in the system.
  std::vector<Eigen::Index> columns;
  for (Eigen::Index i = 0; i < calibration_dim_; ++i) columns.push_back(i);
  for (const auto& [id, at] : prior.lines)
    for (Eigen::Index i = 0; i < 4; ++i) columns.push_back(column_of(ids, id) + i);
  const Eigen::Index rest = prior.g.size() - kStateDim;
  system.lines[0](Eigen::all, columns) += HT.bottomRows(rest).transpose();
  system.line_gradient(columns) += g.tail(rest);
  system.line_block(columns, columns) += prior.H.bottomRightCorner(rest, rest);
}

BinResidual FixedLag::residual(const LineBin& bin, const AnchoredLine& line, std::size_t window) const {
  return bin_to_line(bin, states_[window].event_lag_px, line,
                     inertial_[window].cameras[static_cast<std::size_t>(bin.slot)], projection_.camera);
}

std::optional<Vec2> FixedLag::distances(const LineBin& bin, const AnchoredLine& line,
                                        std::size_t window) const {
  return bin_distances(bin, states_[window].event_lag_px, line,
                       inertial_[window].cameras[static_cast<std::size_t>(bin.slot)], projection_.camera);
}

// After each change of the active states or of the calibration.
void FixedLag::move_cameras() {
  projection_.T_i_c.q = (nominal_.T_i_c.q * quat_exp(calibration_.head<3>())).normalized();
  projection_.camera.fx = nominal_.camera.fx * std::exp(calibration_[3]);
  projection_.camera.fy = nominal_.camera.fy * std::exp(calibration_[3]);
  for (std::size_t w = first_; w < windows_.size(); ++w) {
    inertial_[w].cameras.clear();
    for (const Preintegrated& motion : inertial_[w].bins)
      inertial_[w].cameras.emplace_back(states_[w], later(motion, states_[w].time_shift),
                                        windows_[w].imu->bias(), projection_);
  }
}

FixedLag::WindowRows FixedLag::window_rows(std::size_t window) const {
  const NavState &from = states_[window], &to = states_[window + 1];
  const Inertial& inertial = inertial_[window];
  WindowRows out;
  out.imu = imu_residual(from, to, inertial.motion, windows_[window].imu->bias(), projection_.gravity);
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
  const Eigen::Matrix<double, 15, 9> from_w = r.d_from.transpose() * inertial_[window].weight;
  const Eigen::Matrix<double, 15, 9> to_w = r.d_to.transpose() * inertial_[window].weight;
  system.cost += rows.cost;
  system.diagonal[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_from;
  system.next[slot].topLeftCorner<15, 15>().noalias() += from_w * r.d_to;
  system.diagonal[slot + 1].topLeftCorner<15, 15>().noalias() += to_w * r.d_to;
  system.state_gradient[slot].head<15>().noalias() += from_w * r.value;
  system.state_gradient[slot + 1].head<15>().noalias() += to_w * r.value;

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

double FixedLag::sigma_px(const LineBin& bin) const {
  return options_.bin_sigma_px * std::sqrt(1 + 1.0 / std::max(1, bin.count));
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
  auto to_lines = system.lines[slot].middleCols<4>(column);
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
    to_lines.noalias() += d_state.transpose() * line_w;
    system.line_block.block<4, 4>(column, column).noalias() += line_w.transpose() * r.d_line;
    system.line_gradient.segment<4>(column).noalias() += line_w.transpose() * r.value;
    if (calibration_dim_ == 0) continue;
    const Eigen::Matrix<double, 2, 4> calibration_w = weight * r.d_calibration;
    system.lines[slot].leftCols<4>().noalias() += d_state.transpose() * calibration_w;
    system.line_block.topLeftCorner<4, 4>().noalias() += calibration_w.transpose() * r.d_calibration;
    const Eigen::Matrix4d both = calibration_w.transpose() * r.d_line;
    system.line_block.block<4, 4>(0, column) += both;
    system.line_block.block<4, 4>(column, 0) += both.transpose();
    system.line_gradient.head<4>().noalias() += calibration_w.transpose() * r.value;
  }
}

// What lines say about the state of a window meets first in the cameras of its bins.
std::vector<FixedLag::SightSystem> FixedLag::sight_systems(std::size_t window) const {
  std::vector<SightSystem> out(inertial_[window].cameras.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].by_state.topLeftCorner<6, 16>() = inertial_[window].cameras[k].by_state();
    out[k].by_state(6, 16) = 1;
  }
  return out;
}

void FixedLag::add_sights(ChainSystem& system, const std::vector<SightSystem>& sights, std::size_t slot) {
  for (const SightSystem& sight : sights) {
    const Eigen::Matrix<double, 7, kStateDim> H = sight.H * sight.by_state;
    system.diagonal[slot].noalias() += sight.by_state.transpose() * H;
    system.state_gradient[slot].noalias() += sight.by_state.transpose() * sight.g;
  }
}

ChainSystem FixedLag::linearise(const std::vector<LineId>& ids, const Prior& prior) const {
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
  return system;
}

double FixedLag::cost(const std::vector<LineId>& ids, const Prior& prior) const {
  double sum = prior_cost(prior);
  for (std::size_t w = first_; w < windows_.size(); ++w) sum += window_rows(w).cost;
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    for (const auto& seen : track.seen) {
      if (seen.rejected) continue;
      for (const LineBin& bin : seen.bins)
        if (const auto d = distances(bin, track.line, seen.window)) sum += robust(bin, *d).first;
    }
  }
  return sum;
}

// The prior over the oldest state and the lines in `ids`, the others eliminated.
FixedLag::ReducedPrior FixedLag::reduced_prior(const std::vector<LineId>& ids) const {
  ReducedPrior out;
  Prior& kept = out.prior;
  kept.state = prior_.state;
  kept.calibration = prior_.calibration;
  std::vector<Eigen::Index> order, rest;
  for (Eigen::Index i = 0; i < kStateDim + calibration_dim_; ++i) order.push_back(i);
  for (std::size_t k = 0; k < prior_.lines.size(); ++k) {
    const bool keep = std::binary_search(ids.begin(), ids.end(), prior_.lines[k].first);
    (keep ? kept.lines : out.resting).push_back(prior_.lines[k]);
    for (Eigen::Index i = 0; i < 4; ++i) (keep ? order : rest).push_back(prior_row(k) + i);
  }
  order.insert(order.end(), rest.begin(), rest.end());
  kept.H = prior_.H(order, order);
  kept.g = prior_.g(order);
  out.rest = eliminate_last(kept.H, kept.g, std::ssize(rest));
  return out;
}

// Lines that only the prior knows follow the rest of it.
void FixedLag::update_resting_lines(const ReducedPrior& reduced) {
  if (reduced.rest.y.size() == 0) return;
  const Eigen::VectorXd step = reduced.rest.given(change_since(reduced.prior));
  if (!step.allFinite()) return;
  for (std::size_t k = 0; k < reduced.resting.size(); ++k) {
    const auto& [id, at] = reduced.resting[k];
    tracks_.at(id).line.coordinates = at + step.segment<4>(4 * static_cast<Eigen::Index>(k));
  }
}

void FixedLag::apply(const ChainSystem::Step& step, const std::vector<LineId>& ids) {
  for (std::size_t i = 0; i < step.states.size(); ++i) move(states_[first_ + i], step.states[i]);
  calibration_.head(calibration_dim_) += step.lines.head(calibration_dim_);
  move_cameras();
  for (LineId id : ids) tracks_.at(id).line.move(step.lines.segment<4>(column_of(ids, id)));
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

  ChainSystem system(2, calibration_dim_ + 4 * std::ssize(ids));
  add_prior(system, prior_, ids);
  add_window(system, first_, 0);
  std::vector<SightSystem> sights = sight_systems(first_);
  for (LineId id : ids) {
    const Track& track = tracks_.at(id);
    for (const auto& seen : track.seen)
      if (seen.window == first_ && !seen.rejected)
        add_observation(system, sights, track, seen, 0, column_of(ids, id));
  }
  add_sights(system, sights, 0);
  system.eliminate_first(prior_.H, prior_.g);
  ++first_;
  prior_.state = states_[first_];
  prior_.calibration = calibration_;
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
  prior_ = reduced_prior(kept).prior;
}

}  // namespace idol
