#include "idol/backend/chain_system.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

#include "idol/backend/dense.hpp"

namespace idol {

LineBlocks::Block& LineBlocks::at(Eigen::Index column) {
  const auto it = std::lower_bound(columns_.begin(), columns_.end(), column);
  const auto k = it - columns_.begin();
  if (it == columns_.end() || *it != column) {
    columns_.insert(it, column);
    blocks_.insert(blocks_.begin() + k, Block::Zero());
  }
  return blocks_[static_cast<std::size_t>(k)];
}

void LineBlocks::add_to(Eigen::Ref<Eigen::MatrixXd> rows) const {
  for (std::size_t k = 0; k < blocks_.size(); ++k) rows.middleCols<4>(columns_[k]) += blocks_[k];
}

StateVec LineBlocks::times(const Eigen::VectorXd& lines) const {
  StateVec out = StateVec::Zero();
  for (std::size_t k = 0; k < blocks_.size(); ++k)
    out.noalias() += blocks_[k] * lines.segment<4>(columns_[k]);
  return out;
}

ChainSystem::ChainSystem(std::size_t states, Eigen::Index line_columns)
    : diagonal(states, StateMat::Zero()),
      next(states, StateMat::Zero()),
      lines(states),
      line_block(Eigen::MatrixXd::Zero(line_columns, line_columns)),
      state_gradient(states, StateVec::Zero()),
      line_gradient(Eigen::VectorXd::Zero(line_columns)) {}

// Lines come in the order of their first sight: columns that a state or those before it touch.
std::vector<Eigen::Index> ChainSystem::widths() const {
  std::vector<Eigen::Index> out(lines.size());
  for (std::size_t i = 0; i < lines.size(); ++i) out[i] = std::max(lines[i].width(), i == 0 ? 0 : out[i - 1]);
  return out;
}

ChainSystem::Step ChainSystem::solve(double damping) const {
  const std::size_t n = diagonal.size();
  const Eigen::Index m = line_gradient.size();
  const std::vector<Eigen::Index> width = widths();
  // Forward: W_i = L_i^-1 [T(i, i+1), B_i], y_i = L_i^-1 g_i, subtracted from what follows. The rows of W to
  // the lines stand below each other for several states, so that C changes by few large products; then they
  // go: filled in, those of a long chain would be the largest thing of all.
  constexpr std::size_t kTogether = 32;
  std::vector<StateMat> L(n), to_next(n);
  Eigen::MatrixXd to_lines, before;  // of some states; of the one before them
  std::vector<StateVec> y(n);
  const auto rows = [](std::size_t k) { return static_cast<Eigen::Index>(k) * kStateDim; };
  StateMat D = diagonal[0];
  Eigen::MatrixXd C = line_block;
  Eigen::VectorXd gl = line_gradient;
  C.diagonal() += damping * line_block.diagonal();
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t k = i % kTogether;
    if (k == 0) {
      if (i > 0) before = to_lines.bottomRows<kStateDim>();
      const std::size_t end = std::min(n, i + kTogether);
      to_lines.setZero(rows(end - i), width[end - 1]);
    }
    D.diagonal() += damping * diagonal[i].diagonal();
    const Eigen::LLT<StateMat> factor(D);
    if (factor.info() != Eigen::Success) return {};
    L[i] = factor.matrixL();
    const auto lower = L[i].triangularView<Eigen::Lower>();
    auto B = to_lines.middleRows(rows(k), kStateDim).leftCols(width[i]);
    lines[i].add_to(B);
    y[i] = state_gradient[i];
    if (i > 0) {
      const auto previous = k == 0 ? before.topRows(kStateDim) : to_lines.middleRows(rows(k - 1), kStateDim);
      subtract_product(B.leftCols(width[i - 1]), to_next[i - 1], previous.leftCols(width[i - 1]));
      y[i].noalias() -= to_next[i - 1].transpose() * y[i - 1];
    }
    solve_lower(L[i], B);
    lower.solveInPlace(y[i]);
    gl.head(width[i]).noalias() -= B.transpose() * y[i];
    if (i + 1 == n || k + 1 == kTogether)
      subtract_gram(C.topLeftCorner(to_lines.cols(), to_lines.cols()), to_lines);
    if (i + 1 == n) break;
    to_next[i] = lower.solve(next[i]);
    D = diagonal[i + 1];
    D.noalias() -= to_next[i].transpose() * to_next[i];
  }
  Step step{std::vector<StateVec>(n), -gl, StateMat::Identity()};
  if (!factor_lower(C)) return {};
  C.triangularView<Eigen::Lower>().solveInPlace(step.lines);
  C.transpose().triangularView<Eigen::Upper>().solveInPlace(step.lines);
  Eigen::MatrixXd W = Eigen::MatrixXd::Zero(m, kStateDim);
  W.topRows(width[n - 1]) = to_lines.bottomRows<kStateDim>().leftCols(width[n - 1]).transpose();
  solve_lower(C, W);
  step.last_covariance += W.transpose() * W;
  // Block inverse: (L L')^-1 + what the lines' uncertainty adds.
  const StateMat from_last = L[n - 1].triangularView<Eigen::Lower>().solve(StateMat::Identity());
  step.last_covariance = (from_last.transpose() * step.last_covariance * from_last).eval();
  // With the lines known, the chain alone is left.
  for (std::size_t i = 0; i < n; ++i) {
    step.states[i] = -state_gradient[i] - lines[i].times(step.lines);
    if (i > 0) step.states[i].noalias() -= to_next[i - 1].transpose() * step.states[i - 1];
    L[i].triangularView<Eigen::Lower>().solveInPlace(step.states[i]);
  }
  for (std::size_t i = n; i-- > 0;) {
    if (i + 1 < n) step.states[i].noalias() -= to_next[i] * step.states[i + 1];
    L[i].transpose().triangularView<Eigen::Upper>().solveInPlace(step.states[i]);
  }
  return step;
}

}  // namespace idol
