// What the marginalised windows know about the oldest active state, the calibration and the lines, in
// square-root form.
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

/// The variables that a prior is about, as they are at present. The calibration is empty when it is not
/// refined.
struct PriorVariables {
  const NavState& state;
  const Eigen::VectorXd& calibration;
  const LineLookup& line;
};

/// Cost |R d + r|^2 / 2, R upper triangular, d the change of [lines, calibration, state] from the
/// linearisation point, in the tangent order of a state [p, theta, v, b_g, b_a, time shift, event lag]. The
/// lines stand in the order in which they are expected to be eliminated.
///
/// Shifting the whole world or turning it about the vertical changes no measurement. Which changes of the
/// variables are such moves depends on the linearisation point, and a prior that was linearised elsewhere
/// would hold down the present ones, which nothing has measured. What it knows is where the lines are, seen
/// from its state. A change that moves the state therefore counts as the same move of the world at the
/// prior's own linearisation point: d becomes d + (N_0 - N) m(d), where the columns of N and N_0 are the
/// gauge directions at the present and at the prior's point, and m(d) are shift and turn of the state in d.
class MarginalPrior {
 public:
  MarginalPrior() = default;
  /// `rows` over [lines, calibration, state], linearised at these.
  MarginalPrior(const NavState& state, Eigen::VectorXd calibration,
                std::vector<std::pair<LineId, Vec4>> lines, LeastSquaresRows rows);

  [[nodiscard]] const NavState& state() const { return state_; }
  [[nodiscard]] const std::vector<std::pair<LineId, Vec4>>& lines() const { return lines_; }
  [[nodiscard]] const LeastSquaresRows& rows() const { return rows_; }

  [[nodiscard]] static Eigen::Index line_column(std::size_t k) { return 4 * static_cast<Eigen::Index>(k); }
  [[nodiscard]] Eigen::Index calibration_column() const { return line_column(lines_.size()); }
  [[nodiscard]] Eigen::Index state_column() const { return calibration_column() + calibration_.size(); }

  /// The change of the variables from the linearisation point, as the gauge-consistent prior sees it.
  [[nodiscard]] Eigen::VectorXd change(const PriorVariables& now) const;
  [[nodiscard]] double cost(const PriorVariables& now) const { return rows_.cost(change(now)); }
  /// How that change follows changes of the present state; calibration and lines count one to one.
  using StateColumns = Eigen::Matrix<double, Eigen::Dynamic, kStateDim>;
  [[nodiscard]] StateColumns by_state(const PriorVariables& now) const;
  /// The prior linearised at the present: rows over changes of [lines, calibration, state] from here.
  [[nodiscard]] LeastSquaresRows linearised(const PriorVariables& now) const;

  /// What is left when all lines but those of `ids` (ascending) are eliminated, and how the eliminated ones
  /// follow.
  struct Reduction;
  [[nodiscard]] Reduction reduced(const std::vector<LineId>& ids) const;

 private:
  [[nodiscard]] StateColumns transport(const PriorVariables& now) const;

  NavState state_;
  Eigen::VectorXd calibration_;
  std::vector<std::pair<LineId, Vec4>> lines_;
  LeastSquaresRows rows_;
};

struct MarginalPrior::Reduction {
  MarginalPrior prior;
  std::vector<std::pair<LineId, Vec4>> eliminated;
  EliminatedVariables rest;

  /// Covariance of the coordinates of the eliminated lines, by what the prior says.
  [[nodiscard]] Eigen::MatrixXd covariance() const;
};

/// The prior that is left of `rows` over [old state, lines, calibration, state], all linearised at the
/// present, when the old state is eliminated.
MarginalPrior marginalise(LeastSquaresRows rows, const NavState& state, const Eigen::VectorXd& calibration,
                          std::vector<std::pair<LineId, Vec4>> lines);

}  // namespace idol
