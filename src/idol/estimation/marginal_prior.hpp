// What the marginalised windows know about the oldest active state, the calibration and the lines, in square-root form.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "idol/backend/anchored_line.hpp"
#include "idol/backend/chain_system.hpp"
#include "idol/base/types.hpp"
#include "idol/estimation/square_root.hpp"

namespace idol {

/// Tells the present estimate of a line.
using LineLookup = std::function<const AnchoredLine&(LineId)>;

/// The variables that a prior is about, as they are at present. The calibration is empty when it is not refined.
struct PriorVariables {
  const NavState& state;
  const Eigen::VectorXd& calibration;
  const LineLookup& line;
};

/// Cost |R d + r|^2 / 2, d the change of [state, calibration, lines] from the linearisation point, in the tangent order
/// of a state [p, theta, v, b_g, b_a, time shift, event lag].
///
/// Shifting the whole world or turning it about the vertical changes no measurement. Which changes of the variables are
/// such moves depends on the linearisation point, and a prior that was linearised elsewhere would hold down the present
/// ones, which nothing has measured. What it knows is where the lines are, seen from its state. A change that moves the
/// state therefore counts as the same move of the world at the prior's own linearisation point: d becomes
/// d + (N_0 - N) m(d), where the columns of N and N_0 are the gauge directions at the present and at the prior's point,
/// and m(d) are shift and turn of the state in d.
class MarginalPrior {
 public:
  MarginalPrior() = default;
  /// About a first state alone: `rows` over [state, calibration].
  MarginalPrior(const NavState& state, Eigen::VectorXd calibration, LeastSquaresRows rows);

  [[nodiscard]] const NavState& state() const { return state_; }
  [[nodiscard]] const std::vector<std::pair<LineId, Vec4>>& lines() const { return lines_; }
  [[nodiscard]] const LeastSquaresRows& rows() const { return rows_; }

  /// Rows about a line's coordinates, which now are `at`; the line is new to the prior.
  void add_line(LineId id, const Vec4& at, const Eigen::Matrix<double, Eigen::Dynamic, 4>& rows);
  /// Column of the k-th of lines().
  [[nodiscard]] Eigen::Index column(std::size_t k) const {
    return kStateDim + calibration_.size() + 4 * static_cast<Eigen::Index>(k);
  }

  /// The change of the variables from the linearisation point, as the gauge-consistent prior sees it.
  [[nodiscard]] Eigen::VectorXd change(const PriorVariables& now) const;
  [[nodiscard]] double cost(const PriorVariables& now) const { return rows_.cost(change(now)); }
  /// How that change follows changes of the present state; calibration and lines count one to one.
  using StateColumns = Eigen::Matrix<double, Eigen::Dynamic, kStateDim>;
  [[nodiscard]] StateColumns by_state(const PriorVariables& now) const;
  /// The prior linearised at the present: rows over changes of [state, calibration, lines] from here.
  [[nodiscard]] LeastSquaresRows linearised(const PriorVariables& now) const;

  /// What is left when all lines but those of `ids` (ascending) are eliminated, and how the eliminated ones follow.
  struct Reduction;
  [[nodiscard]] Reduction reduced(const std::vector<LineId>& ids) const;

 private:
  [[nodiscard]] StateColumns transport(const PriorVariables& now) const;

  NavState state_;
  Eigen::VectorXd calibration_;
  std::vector<std::pair<LineId, Vec4>> lines_;  // ascending
  LeastSquaresRows rows_;

  friend MarginalPrior marginalise(const LeastSquaresRows&, const NavState&, const Eigen::VectorXd&,
                                   std::vector<std::pair<LineId, Vec4>>);
};

struct MarginalPrior::Reduction {
  MarginalPrior prior;
  std::vector<std::pair<LineId, Vec4>> eliminated;
  EliminatedVariables rest;

  /// Covariance of the coordinates of the eliminated lines, all else unknown as far as the prior says.
  [[nodiscard]] Eigen::MatrixXd covariance() const;
};

/// The prior that is left of `rows` over [old state, state, calibration, lines], all linearised at the present, when the
/// old state is eliminated.
MarginalPrior marginalise(const LeastSquaresRows& rows, const NavState& state, const Eigen::VectorXd& calibration,
                          std::vector<std::pair<LineId, Vec4>> lines);

}  // namespace idol
