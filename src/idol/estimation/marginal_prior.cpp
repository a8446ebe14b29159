#include "idol/estimation/marginal_prior.hpp"

#include <algorithm>
#include <numeric>

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

MarginalPrior::MarginalPrior(const NavState& state, Eigen::VectorXd calibration, LeastSquaresRows rows)
    : state_(state), calibration_(std::move(calibration)), rows_(std::move(rows)) {}

void MarginalPrior::add_line(LineId id, const Vec4& at, const Eigen::Matrix<double, Eigen::Dynamic, 4>& rows) {
  const auto place = std::lower_bound(lines_.begin(), lines_.end(), id,
                                      [](const auto& line, LineId other) { return line.first < other; });
  const Eigen::Index before = column(static_cast<std::size_t>(place - lines_.begin())), n = rows_.A.cols(),
                     m = rows_.A.rows();
  lines_.emplace(place, id, at);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(m + rows.rows(), n + 4);
  A.topLeftCorner(m, before) = rows_.A.leftCols(before);
  A.topRightCorner(m, n - before) = rows_.A.rightCols(n - before);
  A.block(m, before, rows.rows(), 4) = rows;
  rows_.A = std::move(A);
  rows_.b.conservativeResize(m + rows.rows());
  rows_.b.tail(rows.rows()).setZero();
}

// (N_0 - N) times the move that takes the present state along, and the identity in the state's own rows.
MarginalPrior::StateColumns MarginalPrior::transport(const PriorVariables& now) const {
  const Eigen::Index n = rows_.A.cols();
  GaugeDirections here = GaugeDirections::Zero(n, 4), there = GaugeDirections::Zero(n, 4);
  const Mat3 turn = rotation_jacobian(state_, now.state);
  here.topRows<kStateDim>() = gauge_directions(now.state);
  here.block<3, 1>(3, 3) = turn * here.block<3, 1>(3, 3);
  there.topRows<kStateDim>() = gauge_directions(state_);
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    const Eigen::Index row = column(k);
    AnchoredLine line = now.line(lines_[k].first);
    here.middleRows<4>(row) = line.world_moves();
    line.coordinates = lines_[k].second;
    there.middleRows<4>(row) = line.world_moves();
  }
  Eigen::Matrix<double, 4, kStateDim> move = Eigen::Matrix<double, 4, kStateDim>::Zero();
  move.topLeftCorner<3, 3>().setIdentity();
  const RowVec3 yaw = here.block<3, 1>(3, 3).transpose() / here.block<3, 1>(3, 3).squaredNorm();
  move.block<1, 3>(3, 3) = yaw;
  move.block<3, 3>(0, 3) = -here.col(3).head<3>() * yaw;
  StateColumns out = (there - here) * move;
  out.topRows<kStateDim>() += StateMat::Identity();
  return out;
}

Eigen::VectorXd MarginalPrior::change(const PriorVariables& now) const {
  Eigen::VectorXd d = Eigen::VectorXd::Zero(rows_.A.cols());
  d.segment(kStateDim, calibration_.size()) = now.calibration - calibration_;
  for (std::size_t k = 0; k < lines_.size(); ++k)
    d.segment<4>(column(k)) = now.line(lines_[k].first).coordinates - lines_[k].second;
  return d + transport(now) * difference(state_, now.state);
}

MarginalPrior::StateColumns MarginalPrior::by_state(const PriorVariables& now) const {
  StateColumns out = transport(now);
  out.middleCols<3>(3) = (out.middleCols<3>(3) * rotation_jacobian(state_, now.state)).eval();
  return out;
}

LeastSquaresRows MarginalPrior::linearised(const PriorVariables& now) const {
  LeastSquaresRows out{rows_.A, rows_.A * change(now) + rows_.b};
  out.A.leftCols<kStateDim>() = rows_.A * by_state(now);
  return out;
}

MarginalPrior::Reduction MarginalPrior::reduced(const std::vector<LineId>& ids) const {
  Reduction out;
  MarginalPrior& kept = out.prior;
  kept.state_ = state_;
  kept.calibration_ = calibration_;
  std::vector<Eigen::Index> order, rest(static_cast<std::size_t>(column(0)));
  std::iota(rest.begin(), rest.end(), 0);
  for (std::size_t k = 0; k < lines_.size(); ++k) {
    const bool keep = std::binary_search(ids.begin(), ids.end(), lines_[k].first);
    (keep ? kept.lines_ : out.eliminated).push_back(lines_[k]);
    for (Eigen::Index i = 0; i < 4; ++i) (keep ? rest : order).push_back(column(k) + i);
  }
  const auto count = std::ssize(order);
  if (count == 0) {
    kept.rows_ = rows_;
    return out;
  }
  order.insert(order.end(), rest.begin(), rest.end());
  kept.rows_ = {rows_.A(Eigen::all, order), rows_.b};
  out.rest = eliminate_leading(kept.rows_, count);
  return out;
}

// With all rows [R_e W; 0 R_k] triangular: R_e^-1 (I + W (R_k' R_k)^-1 W') R_e^-T.
Eigen::MatrixXd MarginalPrior::Reduction::covariance() const {
  const Eigen::MatrixXd& kept = prior.rows().A;
  const Eigen::Index n = kept.cols();
  Eigen::MatrixXd R_k(kept.rows() + n, n);
  R_k << kept, kLeastInformation * Eigen::MatrixXd::Identity(n, n);
  replace_by_triangular_factor(R_k);
  Eigen::MatrixXd Z = rest.W.transpose();
  R_k.transpose().triangularView<Eigen::Lower>().solveInPlace(Z);
  Eigen::MatrixXd M = Z.transpose() * Z;
  M.diagonal().array() += 1;
  rest.R.triangularView<Eigen::Upper>().solveInPlace(M);
  M.transposeInPlace();
  rest.R.triangularView<Eigen::Upper>().solveInPlace(M);
  return M;
}

MarginalPrior marginalise(const LeastSquaresRows& rows, const NavState& state, const Eigen::VectorXd& calibration,
                          std::vector<std::pair<LineId, Vec4>> lines) {
  MarginalPrior out(state, calibration, rows);
  eliminate_leading(out.rows_, kStateDim);
  out.lines_ = std::move(lines);
  return out;
}

}  // namespace idol
