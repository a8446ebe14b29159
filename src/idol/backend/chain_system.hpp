// Normal equations of a chain of states and the lines they see: H x = -g with
//   H = | T  B |   T block tridiagonal (17 x 17 blocks, one a state), B states x lines, C lines x lines.
//       | B' C |
// States are eliminated in order, each against its successor and the lines.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace idol {

constexpr int kStateDim = 17;  ///< pose, velocity, biases, time shift, event lag
using StateMat = Eigen::Matrix<double, kStateDim, kStateDim>;
using StateVec = Eigen::Matrix<double, kStateDim, 1>;

/// One state's rows of B, which are zero but for a block of 17 x 4 at each line that it sees.
class LineBlocks {
 public:
  using Block = Eigen::Matrix<double, kStateDim, 4>;

  /// The block from a column on, a multiple of 4; zero if it was not there.
  Block& at(Eigen::Index column);
  /// Columns up to the last block's end.
  [[nodiscard]] Eigen::Index width() const { return columns_.empty() ? 0 : columns_.back() + 4; }
  /// Adds all blocks to `rows`, 17 x at least width().
  void add_to(Eigen::Ref<Eigen::MatrixXd> rows) const;
  [[nodiscard]] StateVec times(const Eigen::VectorXd& lines) const;

 private:
  std::vector<Eigen::Index> columns_;  // ascending
  std::vector<Block> blocks_;
};

struct ChainSystem {
  ChainSystem(std::size_t states, Eigen::Index line_columns);

  std::vector<StateMat> diagonal;  ///< of T
  std::vector<StateMat> next;      ///< T(i, i + 1)
  std::vector<LineBlocks> lines;   ///< B
  Eigen::MatrixXd line_block;      ///< C
  std::vector<StateVec> state_gradient;
  Eigen::VectorXd line_gradient;
  double cost = 0;

  struct Step {
    std::vector<StateVec> states;
    Eigen::VectorXd lines;
    StateMat last_covariance;  ///< of the last state, everything else marginalised
  };
  /// Minimises the quadratic model with the diagonal raised by the share `damping`. Empty lists if H is not
  /// positive.
  [[nodiscard]] Step solve(double damping) const;

 private:
  [[nodiscard]] std::vector<Eigen::Index> widths() const;
};

}  // namespace idol
