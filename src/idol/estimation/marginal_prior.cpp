#include "idol/estimation/marginal_prior.hpp"

#include <algorithm>

#include "idol/backend/dense.hpp"

namespace idol {
namespace {

// Change from `from` to `to`.
StateVec difference(const NavState& from, const NavState& to) {
  StateVec d;
  d << to.T_w_i.p - from.T_w_i.p, quat_log(from.T_w_i.q.conjugate() * to.T_w_i.q), to.v_w - from.v_w,
      to.bias.gyro - from.bias.gyro, to.bias.accel - from.bias.accel, to.time_shift - from.time_shift,
      to.event_lag_px - from.event_lag_px;
  return d;
}

// Derivative of the rotation part of `difference` to a change of `to`.
Mat3 rotation_jacobian(const NavState& from, const NavState& to) {
  return right_jacobian_inverse(quat_log(from.T_w_i.q.conjugate() * to.T_w_i.q));
}

using GaugeDirections = Eigen::Matrix<double, Eigen::Dynamic, 4>;

// Columns: how a state changes when the world is shifted along its x, y, z or turned about its z axis.
Eigen::Matrix<double, kStateDim, 4> gauge_directions(const NavState& state) {
  Eigen::Matrix<double, kStateDim, 4> out = Eigen::Matrix<double, kStateDim, 4>::Zero();
  out.topLeftCorner<3, 3>().setIdentity();
  out.col(3).head<3>() = Vec3::UnitZ().cross(state.T_w_i.p);
  out.col(3).segment<3>(3) = state.T_w_i.q.conjugate() * Vec3::UnitZ();
  out.col(3).segment<3>(6) = Vec3::UnitZ().cross(state.v_w);
  return out;
}

}  // namespace

MarginalPrior::MarginalPrior(const NavState& state, Eigen::VectorXd calibration,
                             std::vector<std::pair<LineId, Vec4>> lines, LeastSquaresRows rows)
    : state_(state), calibration_(std::move(calibration)), lines_(std::move(lines)), rows_(std::move(rows)) {}

// (N_0 - N) times the move that takes the present state along, and the identity in the state's own rows.
MarginalPrior::StateColumns MarginalPrior::transport(const PriorVariables& now) const {
  const Eigen::Index n = rows_.A.cols();
  GaugeDirections here = GaugeDirections::Zero(n, 4), there = GaugeDirections::Zero(n, 4);
  const Mat3 turn = rotation_jacobian(state_, now.state);
  Eigen::Matrix<double, kStateDim, 4> of_state = gauge_directions(now.state);
  of_state.block<3, 1>(3, 3) = turn * of_state.block<3, 1>(3, 3);
  here.bottomRows<kStateDim>() = of_state;
  there.bottomRows<kStateDim>() = gauge_directions(state_);
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    const Eigen::Index row = line_column(k);
    AnchoredLine line = now.line(lines_[k].first);
    here.middleRows<4>(row) = line.world_moves();
    line.coordinates = lines_[k].second;
    there.middleRows<4>(row) = line.world_moves();
  }
  Eigen::Matrix<double, 4, kStateDim> move = Eigen::Matrix<double, 4, kStateDim>::Zero();
  move.topLeftCorner<3, 3>().setIdentity();
  const RowVec3 yaw = of_state.block<3, 1>(3, 3).transpose() / of_state.block<3, 1>(3, 3).squaredNorm();
  move.block<1, 3>(3, 3) = yaw;
  move.block<3, 3>(0, 3) = -of_state.col(3).head<3>() * yaw;
  StateColumns out = (there - here) * move;
  out.bottomRows<kStateDim>() += StateMat::Identity();
  return out;
}

Eigen::VectorXd MarginalPrior::change(const PriorVariables& now) const {
  Eigen::VectorXd d = Eigen::VectorXd::Zero(rows_.A.cols());
  for (std::size_t k = 0; k < lines_.size(); ++k)
    d.segment<4>(line_column(k)) = now.line(lines_[k].first).coordinates - lines_[k].second;
  d.segment(calibration_column(), calibration_.size()) = now.calibration - calibration_;
  return d + transport(now) * difference(state_, now.state);
}

MarginalPrior::StateColumns MarginalPrior::by_state(const PriorVariables& now) const {
  StateColumns out = transport(now);
  out.middleCols<3>(3) = (out.middleCols<3>(3) * rotation_jacobian(state_, now.state)).eval();
  return out;
}

LeastSquaresRows MarginalPrior::linearised(const PriorVariables& now) const {
  LeastSquaresRows out{rows_.A, rows_.A * change(now) + rows_.b};
  out.A.rightCols<kStateDim>() = rows_.A * by_state(now);
  return out;
}

// The leading lines that go are eliminated already: R is triangular. Only what stands behind the first line
// that stays is factored again.
MarginalPrior::Reduction MarginalPrior::reduced(const std::vector<LineId>& ids) const {
  const auto stays = [&](const auto& line) { return std::binary_search(ids.begin(), ids.end(), line.first); };
  Reduction out;
  const auto first = std::find_if(lines_.begin(), lines_.end(), stays);
  out.eliminated.assign(lines_.begin(), first);
  const Eigen::Index leading = 4 * (first - lines_.begin()), n = rows_.A.cols();
  std::vector<std::pair<LineId, Vec4>> kept;
  std::vector<Eigen::Index> order, rest;
  for (auto line = first; line != lines_.end(); ++line) {
    (stays(*line) ? kept : out.eliminated).push_back(*line);
    for (Eigen::Index i = 0; i < 4; ++i)
      (stays(*line) ? rest : order).push_back(4 * (line - lines_.begin()) + i);
  }
  const auto others = std::ssize(order);
  order.insert(order.end(), rest.begin(), rest.end());
  for (Eigen::Index i = calibration_column(); i < n; ++i) order.push_back(i);
  LeastSquaresRows rows{rows_.A(Eigen::seq(leading, n - 1), order), rows_.b.tail(n - leading)};
  EliminatedVariables behind;
  if (others > 0) behind = eliminate_leading(rows, others);
  const Eigen::Index gone = leading + others;
  out.rest = {Eigen::MatrixXd::Zero(gone, gone), Eigen::MatrixXd(gone, n - gone), Eigen::VectorXd(gone)};
  const Eigen::MatrixXd beside = rows_.A(Eigen::seqN(0, leading), order);
  out.rest.R.topLeftCorner(leading, leading) = rows_.A.topLeftCorner(leading, leading);
  out.rest.R.topRightCorner(leading, others) = beside.leftCols(others);
  out.rest.W.topRows(leading) = beside.rightCols(n - gone);
  out.rest.y.head(leading) = rows_.b.head(leading);
  if (others > 0) {
    out.rest.R.bottomRightCorner(others, others) = behind.R;
    out.rest.W.bottomRows(others) = behind.W;
    out.rest.y.tail(others) = behind.y;
  }
  out.prior = MarginalPrior(state_, calibration_, std::move(kept), std::move(rows));
  return out;
}

// With all rows [R_e W; 0 R_k] triangular: R_e^-1 (I + W (R_k' R_k)^-1 W') R_e^-T.
Eigen::MatrixXd MarginalPrior::Reduction::covariance() const {
  Eigen::MatrixXd Z = rest.W.transpose();
  prior.rows().A.transpose().triangularView<Eigen::Lower>().solveInPlace(Z);
  Eigen::MatrixXd M = gram(Z);
  M.diagonal().array() += 1;
  rest.R.triangularView<Eigen::Upper>().solveInPlace(M);
  M.transposeInPlace();
  rest.R.triangularView<Eigen::Upper>().solveInPlace(M);
  return M;
}

MarginalPrior marginalise(LeastSquaresRows rows, const NavState& state, const Eigen::VectorXd& calibration,
                          std::vector<std::pair<LineId, Vec4>> lines) {
  eliminate_leading(rows, kStateDim);
  return {state, calibration, std::move(lines), std::move(rows)};
}

}  // namespace idol
