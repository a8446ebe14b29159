// Normal equations of a chain of states and the lines they see: H x = -g with
//   H = | T  B |   T block tridiagonal (17 x 17 blocks, one a state), B states x lines, C lines x lines.
//       | B' C |
// States are eliminated in order, each against its successor and the lines; what the first elimination leaves
// behind is the marginal prior of a sliding window (Schur complement).
#pragma once

#include <Eigen/Core>
#include <vector>

namespace idol {

constexpr int kStateDim = 17;  ///< pose, velocity, biases, time shift, event lag
using StateMat = Eigen::Matrix<double, kStateDim, kStateDim>;
using StateVec = Eigen::Matrix<double, kStateDim, 1>;

struct ChainSystem {
  ChainSystem(std::size_t states, Eigen::Index line_columns);

  std::vector<StateMat> diagonal;      ///< of T
  std::vector<StateMat> next;          ///< T(i, i + 1)
  std::vector<Eigen::MatrixXd> lines;  ///< rows of B: 17 x line columns
  Eigen::MatrixXd line_block;          ///< C
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
  /// Schur complement of the first state of a chain of two: order second state, lines. H and g.
  void eliminate_first(Eigen::MatrixXd& H, Eigen::VectorXd& g) const;

 private:
  [[nodiscard]] std::vector<Eigen::Index> widths() const;
};

/// How eliminated variables follow those that are kept: d = -L^-T (y + W d_kept).
struct Eliminated {
  Eigen::MatrixXd L, W;
  Eigen::VectorXd y;
  [[nodiscard]] Eigen::VectorXd given(const Eigen::VectorXd& kept) const;
};

/// Schur complement of the trailing `count` variables of a quadratic model. Its null directions, if any, stay
/// out. The return value is empty if there are none, or if they have no factor: then they count as known.
Eliminated eliminate_last(Eigen::MatrixXd& H, Eigen::VectorXd& g, Eigen::Index count);

}  // namespace idol
