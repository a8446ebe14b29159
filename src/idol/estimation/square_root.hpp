// Least squares in square-root form: a cost |A d + b|^2 / 2 is kept as its rows [A, b] and never as the
// information matrix A' A. Rows are added by stacking and variables eliminated by a QR factorisation, so that
// no sum of costs can become indefinite, whatever the rounding (Bierman, Factorization Methods for Discrete
// Sequential Estimation, 1977).
#pragma once

#include <Eigen/Core>
#include <initializer_list>
#include <utility>
#include <vector>

namespace idol {

/// A variable that nothing has measured would leave a zero on the diagonal of a triangular factor, and what
/// the row there says about other variables would be lost with it. Each variable is therefore known to the
/// inverse of this, in its own unit: far less than any measurement says, far more than the rounding of what
/// they say.
constexpr double kLeastInformation = 1e-5;

/// Rows of a linear least-squares cost |A d + b|^2 / 2 over some variables d.
struct LeastSquaresRows {
  Eigen::MatrixXd A;  ///< rows x variables
  Eigen::VectorXd b;

  [[nodiscard]] double cost(const Eigen::VectorXd& d) const { return 0.5 * (A * d + b).squaredNorm(); }
};

/// Collects rows of several costs and stands them below each other.
class RowStack {
 public:
  /// Rows that are zero but for blocks at the given first columns. `b` has as many elements as each block has
  /// rows.
  void add(std::initializer_list<std::pair<Eigen::Index, Eigen::MatrixXd>> blocks, Eigen::VectorXd b);
  /// Over so many variables.
  [[nodiscard]] LeastSquaresRows stacked(Eigen::Index variables) const;

 private:
  struct Piece {
    std::vector<std::pair<Eigen::Index, Eigen::MatrixXd>> blocks;
    Eigen::VectorXd b;
  };
  std::vector<Piece> pieces_;
  Eigen::Index rows_ = 0;
};

/// How eliminated variables follow those that are kept: R d = -(y + W d_kept), R upper triangular.
struct EliminatedVariables {
  Eigen::MatrixXd R, W;
  Eigen::VectorXd y;

  /// Minimum-cost change of the eliminated variables.
  [[nodiscard]] Eigen::VectorXd given(const Eigen::VectorXd& kept) const;
};

/// Replaces rows over [eliminated, kept] variables by an upper triangle over the kept ones alone that costs
/// the same, but for a constant, once the first `count` variables have been minimised over. All of these must
/// have been measured, if only by kLeastInformation.
EliminatedVariables eliminate_leading(LeastSquaresRows& rows, Eigen::Index count);

}  // namespace idol
