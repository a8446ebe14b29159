// What the fixed lag keeps of the past: a prior over its oldest state and the lines, and how it is used and
// made.
#include <Eigen/Cholesky>
#include <algorithm>

#include "idol/backend/fixed_lag.hpp"

namespace idol {
namespace {

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
  // Where each four of its other variables stand in the system.
  std::vector<Eigen::Index> columns;
  if (calibration_dim_ > 0) columns.push_back(0);
  for (const auto& [id, at] : prior.lines) columns.push_back(column_of(ids, id));
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const Eigen::Index row = kStateDim + 4 * static_cast<Eigen::Index>(k);
    system.lines[0].at(columns[k]) += HT.middleRows<4>(row).transpose();
    system.line_gradient.segment<4>(columns[k]) += g.segment<4>(row);
    for (std::size_t l = 0; l < columns.size(); ++l)
      system.line_block.block<4, 4>(columns[k], columns[l]) +=
          prior.H.block<4, 4>(row, kStateDim + 4 * static_cast<Eigen::Index>(l));
  }
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
  std::vector<TimedCamera>().swap(inertial_[first_]->cameras);
  windows_[first_].imu.reset();
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

// Only the states stay: memory hardly grows with the length of a run. (Assigning {} to a vector would keep
// it.)
void FixedLag::drop_past() {
  for (auto& [id, track] : tracks_) std::vector<Observation>().swap(track.past);
  for (; dropped_ < first_; ++dropped_) {
    windows_[dropped_].imu.reset();  // of a window left behind by a restart
    inertial_[dropped_].reset();
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
