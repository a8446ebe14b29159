#include "idol/backend/chain_system.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace idol {
namespace {

// Keeps the Cholesky factor of a block with an unobserved direction from failing, far below any information.
template <class Matrix>
void lift(Matrix& H) {
  constexpr double kShare = 1e-15;
  H.diagonal().array() += kShare * (H.diagonal().cwiseAbs().maxCoeff() + 1);
}

}  // namespace

ChainSystem::ChainSystem(std::size_t states, Eigen::Index line_columns)
    : diagonal(states, StateMat::Zero()),
      next(states, StateMat::Zero()),
      lines(states, Eigen::MatrixXd::Zero(kStateDim, line_columns)),
      line_block(Eigen::MatrixXd::Zero(line_columns, line_columns)),
      state_gradient(states, StateVec::Zero()),
      line_gradient(Eigen::VectorXd::Zero(line_columns)) {}

// Lines come in the order of their first sight: columns that a state or those before it touch.
std::vector<Eigen::Index> ChainSystem::widths() const {
  std::vector<Eigen::Index> out(lines.size());
  for (std::size_t i = 0; i < lines.size(); ++i) {
    Eigen::Index last = lines[i].cols();
    const Eigen::Index before = i == 0 ? 0 : out[i - 1];
    while (last > before && lines[i].col(last - 1).isZero(0)) --last;
    out[i] = std::max(last, before);
  }
  return out;
}

ChainSystem::Step ChainSystem::solve(double damping) const {
  const std::size_t n = diagonal.size();
  const Eigen::Index m = line_gradient.size();
  const std::vector<Eigen::Index> width = widths();
  // Forward: W_i = L_i^-1 [T(i, i+1), B_i], y_i = L_i^-1 g_i, subtracted from what follows.
  std::vector<StateMat> L(n), to_next(n);
  std::vector<Eigen::MatrixXd> to_lines(n);
  std::vector<StateVec> y(n);
  StateMat D = diagonal[0];
  Eigen::MatrixXd B = lines[0].leftCols(width[0]);
  StateVec g = state_gradient[0];
  Eigen::MatrixXd C = line_block;
  Eigen::VectorXd gl = line_gradient;
  C.diagonal() += damping * line_block.diagonal();
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Index w = width[i];
    D.diagonal() += damping * diagonal[i].diagonal();
    const Eigen::LLT<StateMat> factor(D);
    if (factor.info() != Eigen::Success) return {};
    L[i] = factor.matrixL();
    const auto lower = L[i].triangularView<Eigen::Lower>();
    to_lines[i] = B;  // may have no columns: Eigen's products want at least one
    y[i] = lower.solve(g);
    if (w > 0) {
      lower.solveInPlace(to_lines[i]);
      C.topLeftCorner(w, w).selfadjointView<Eigen::Lower>().rankUpdate(to_lines[i].transpose(), -1);
      gl.head(w).noalias() -= to_lines[i].transpose() * y[i];
    }
    if (i + 1 == n) break;
    to_next[i] = lower.solve(next[i]);
    D = diagonal[i + 1];
    D.noalias() -= to_next[i].transpose() * to_next[i];
    B = lines[i + 1].leftCols(width[i + 1]);
    if (w > 0) B.leftCols(w).noalias() -= to_next[i].transpose() * to_lines[i];
    g = state_gradient[i + 1];
    g.noalias() -= to_next[i].transpose() * y[i];
  }
  Step step{std::vector<StateVec>(n), Eigen::VectorXd::Zero(m), StateMat::Identity()};
  if (m > 0) {
    const Eigen::LLT<Eigen::MatrixXd> factor(C);  // reads the lower half
    if (factor.info() != Eigen::Success) return {};
    step.lines = factor.solve(-gl);
    Eigen::MatrixXd W = Eigen::MatrixXd::Zero(m, kStateDim);
    W.topRows(width[n - 1]) = to_lines[n - 1].transpose();
    factor.matrixL().solveInPlace(W);
    step.last_covariance += W.transpose() * W;
  }
  // Block inverse: (L L')^-1 + what the lines' uncertainty adds.
  const StateMat from_last = L[n - 1].triangularView<Eigen::Lower>().solve(StateMat::Identity());
  step.last_covariance = (from_last.transpose() * step.last_covariance * from_last).eval();
  for (std::size_t i = n; i-- > 0;) {
    StateVec right = -y[i];
    if (width[i] > 0) right -= to_lines[i] * step.lines.head(width[i]);
    if (i + 1 < n) right -= to_next[i] * step.states[i + 1];
    step.states[i] = L[i].transpose().triangularView<Eigen::Upper>().solve(right);
  }
  return step;
}

void ChainSystem::eliminate_first(Eigen::MatrixXd& H, Eigen::VectorXd& g) const {
  const Eigen::Index m = line_gradient.size();
  H.resize(kStateDim + m, kStateDim + m);
  g.resize(kStateDim + m);
  H << diagonal[1], lines[1], lines[1].transpose(), line_block;
  g << state_gradient[1], line_gradient;
  StateMat D = diagonal[0];
  lift(D);
  const Eigen::LLT<StateMat> factor(D);
  Eigen::MatrixXd W(kStateDim, kStateDim + m);
  W << next[0], lines[0];
  factor.matrixL().solveInPlace(W);
  const StateVec y = factor.matrixL().solve(state_gradient[0]);
  H.noalias() -= W.transpose() * W;
  g.noalias() -= W.transpose() * y;
}

void eliminate_last(Eigen::MatrixXd& H, Eigen::VectorXd& g, Eigen::Index count) {
  if (count == 0) return;
  const Eigen::Index keep = g.size() - count;
  Eigen::MatrixXd D = H.bottomRightCorner(count, count);
  lift(D);
  const Eigen::LLT<Eigen::MatrixXd> factor(D);
  const Eigen::MatrixXd W = factor.matrixL().solve(H.bottomLeftCorner(count, keep));
  const Eigen::VectorXd y = factor.matrixL().solve(g.tail(count));
  Eigen::MatrixXd kept = H.topLeftCorner(keep, keep);
  kept.noalias() -= W.transpose() * W;
  const Eigen::VectorXd left = g.head(keep) - W.transpose() * y;
  H = kept;
  g = left;
}

}  // namespace idol
