// Least squares in square-root form, and the prior made of it.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "idol/estimation/marginal_prior.hpp"

namespace idol::test {
namespace {

TEST(SquareRoot, EliminationLeavesTheCostAtItsMinimum) {
  std::srand(7);
  constexpr Eigen::Index kGone = 9, kKept = 6;
  const LeastSquaresRows all{Eigen::MatrixXd::Random(40, kGone + kKept), Eigen::VectorXd::Random(40)};
  LeastSquaresRows left = all;
  const EliminatedVariables gone = eliminate_leading(left, kGone);
  EXPECT_TRUE(left.A.isUpperTriangular(0));
  // Least cost over the eliminated variables, by the normal equations.
  const auto least = [&](const Eigen::VectorXd& kept) {
    const Eigen::VectorXd b = all.b + all.A.rightCols(kKept) * kept;
    const Eigen::MatrixXd A = all.A.leftCols(kGone);
    Eigen::VectorXd d(kGone + kKept);
    d << (A.transpose() * A).ldlt().solve(-A.transpose() * b), kept;
    return d;
  };
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(kKept);
  const double constant = all.cost(least(zero)) - left.cost(zero);
  for (int k = 0; k < 3; ++k) {
    const Eigen::VectorXd kept = Eigen::VectorXd::Random(kKept), d = least(kept);
    EXPECT_NEAR(all.cost(d), left.cost(kept) + constant, 1e-10);
    EXPECT_LT((gone.given(kept) - d.head(kGone)).norm(), 1e-10);
  }
}

// Without its least information an unmeasured variable would take a row about others with it.
TEST(SquareRoot, AnUnmeasuredVariableTakesNothingWithIt) {
  RowStack rows;
  rows.add({{0, Eigen::MatrixXd::Constant(1, 1, kLeastInformation)}}, Eigen::VectorXd::Zero(1));
  rows.add({{1, Eigen::MatrixXd::Constant(1, 1, 3)}}, Eigen::VectorXd::Constant(1, -6));
  LeastSquaresRows left = rows.stacked(2);
  eliminate_leading(left, 1);
  EXPECT_NEAR(std::abs(left.A(0, 0)), 3, 1e-9);
  EXPECT_NEAR(-left.b[0] / left.A(0, 0), 2, 1e-9);
}

AnchoredLine some_line(LineId id) {
  AnchoredLine line;
  line.anchor.T_w_c = {quat_exp(Vec3(0.1, 0.05 * static_cast<double>(id), -0.1)), Vec3(0.1, 0.2, 0.3)};
  line.anchor.a = {-0.1, 0.02};
  line.anchor.b = {0.2, 0.05};
  line.coordinates = Vec4(0.01, 0.5, -0.02, 0.4);
  return line;
}

MarginalPrior some_prior(int lines, const NavState& state) {
  std::srand(8);
  const Eigen::Index n = 4 * lines + 4 + kStateDim;
  LeastSquaresRows rows{Eigen::MatrixXd::Random(2 * n, n), Eigen::VectorXd::Random(2 * n)};
  eliminate_leading(rows, 0);
  std::vector<std::pair<LineId, Vec4>> known;
  for (LineId id = 0; id < lines; ++id) known.emplace_back(id, some_line(id).coordinates);
  return {state, Eigen::Vector4d::Zero(), std::move(known), std::move(rows)};
}

// Whichever lines go, what is left of the prior and the covariance of those that went are the dense ones.
TEST(MarginalPrior, ReducingIsExactForAnySetOfLines) {
  const MarginalPrior prior = some_prior(5, {});
  const Eigen::MatrixXd covariance = (prior.rows().A.transpose() * prior.rows().A).inverse();
  const Eigen::VectorXd mean = -covariance * prior.rows().A.transpose() * prior.rows().b;
  for (const std::vector<LineId>& ids :
       {std::vector<LineId>{3, 4}, {0, 2}, {1, 2, 3, 4}, {}, {0, 1, 2, 3, 4}}) {
    const auto reduction = prior.reduced(ids);
    std::vector<Eigen::Index> kept, gone;
    for (const auto& [id, at] : reduction.prior.lines())
      for (int i = 0; i < 4; ++i) kept.push_back(4 * id + i);
    for (const auto& [id, at] : reduction.eliminated)
      for (int i = 0; i < 4; ++i) gone.push_back(4 * id + i);
    for (Eigen::Index i = prior.calibration_column(); i < covariance.rows(); ++i) kept.push_back(i);
    const Eigen::MatrixXd& R = reduction.prior.rows().A;
    EXPECT_LT(((R.transpose() * R).inverse() - covariance(kept, kept)).norm(), 1e-7);
    EXPECT_LT((R * mean(kept) + reduction.prior.rows().b).norm(), 1e-8);
    ASSERT_EQ(reduction.eliminated.size(), 5 - ids.size());
    if (gone.empty()) continue;
    EXPECT_LT((reduction.rest.given(mean(kept)) - mean(gone)).norm(), 1e-8);
    EXPECT_LT((reduction.covariance() - covariance(gone, gone)).norm(), 1e-7);
  }
}

// The cost of a world that is moved as a whole is that at the linearisation point, although the state's and
// the lines' changes are large: what the prior says of the start alone is left out here.
TEST(MarginalPrior, FollowsTheWorldWhenItIsShifted) {
  NavState state;
  state.T_w_i = {quat_exp(Vec3(0.2, -0.1, 0.4)), Vec3(1, 2, 0.5)};
  state.v_w = Vec3(0.3, 0.1, 0);
  MarginalPrior prior = some_prior(3, state);
  // Rows that no shift of the world changes.
  Eigen::MatrixXd N = Eigen::MatrixXd::Zero(prior.rows().A.cols(), 3);
  for (LineId id = 0; id < 3; ++id) N.middleRows<4>(4 * id) = some_line(id).world_moves().leftCols<3>();
  N.middleRows<3>(prior.state_column()).setIdentity();
  const Eigen::MatrixXd away =
      Eigen::MatrixXd::Identity(N.rows(), N.rows()) - N * (N.transpose() * N).inverse() * N.transpose();
  LeastSquaresRows rows{prior.rows().A * away, prior.rows().b};
  std::vector<std::pair<LineId, Vec4>> lines = prior.lines();
  prior = MarginalPrior(state, Eigen::Vector4d::Zero(), lines, rows);
  const Vec3 shift(0.3, -0.2, 0.1);
  std::vector<AnchoredLine> moved;
  for (LineId id = 0; id < 3; ++id) {
    AnchoredLine line = some_line(id);
    LineEnds ends = line.ends();
    ends.a += shift;
    ends.b += shift;
    line.coordinates = AnchoredLine::coordinates_of(ends, line.anchor).value();
    moved.push_back(line);
  }
  NavState now = state;
  now.T_w_i.p += shift;
  const Eigen::VectorXd calibration = Eigen::Vector4d::Zero();
  const LineLookup lookup = [&](LineId id) -> const AnchoredLine& {
    return moved[static_cast<std::size_t>(id)];
  };
  const PriorVariables there{now, calibration, lookup};
  // The residual does not change to first order; the lines' coordinates are not linear in the shift.
  EXPECT_LT((prior.linearised(there).b - rows.b).norm(), 0.2 * (rows.A * N * shift).norm() + 0.3);
  // And a further shift from there does not either.
  Eigen::VectorXd further = Eigen::VectorXd::Zero(N.rows());
  for (LineId id = 0; id < 3; ++id)
    further.segment<4>(4 * id) = moved[static_cast<std::size_t>(id)].world_moves().leftCols<3>() * shift;
  further.segment<3>(prior.state_column()) = shift;
  EXPECT_LT((prior.linearised(there).A * further).norm(), 1e-9);
}

}  // namespace
}  // namespace idol::test
