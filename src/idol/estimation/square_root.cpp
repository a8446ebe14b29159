#include "idol/estimation/square_root.hpp"

#include <algorithm>

#include "idol/backend/dense.hpp"

namespace idol {

void RowStack::add(std::initializer_list<std::pair<Eigen::Index, Eigen::MatrixXd>> blocks,
                   Eigen::VectorXd b) {
  rows_ += b.size();
  pieces_.push_back({{blocks.begin(), blocks.end()}, std::move(b)});
}

LeastSquaresRows RowStack::stacked(Eigen::Index variables) const {
  LeastSquaresRows out{Eigen::MatrixXd::Zero(rows_, variables), Eigen::VectorXd(rows_)};
  Eigen::Index row = 0;
  for (const Piece& piece : pieces_) {
    for (const auto& [column, block] : piece.blocks)
      out.A.block(row, column, block.rows(), block.cols()) = block;
    out.b.segment(row, piece.b.size()) = piece.b;
    row += piece.b.size();
  }
  return out;
}

Eigen::VectorXd EliminatedVariables::given(const Eigen::VectorXd& kept) const {
  Eigen::VectorXd d = -(y + W * kept);
  R.triangularView<Eigen::Upper>().solveInPlace(d);
  return d;
}

EliminatedVariables eliminate_leading(LeastSquaresRows& rows, Eigen::Index count) {
  const Eigen::Index n = rows.A.cols(), m = rows.A.rows(), kept = n - count;
  // Fewer rows than variables would leave R without its triangular shape.
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(std::max(m, n + 1), n + 1);
  all.topLeftCorner(m, n) = rows.A;
  all.col(n).head(m) = rows.b;
  replace_by_triangular_factor(all);
  // The last row is the smallest cost that the variables allow: a constant.
  rows.A = all.block(count, count, kept, kept);
  rows.b = all.col(n).segment(count, kept);
  return {all.topLeftCorner(count, count), all.block(0, count, count, kept), all.col(n).head(count)};
}

}  // namespace idol
