// What the fixed lag keeps of the past: the marginal prior over its oldest state and the lines, how it is
// used and how it is made.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "idol/backend/dense.hpp"
#include "idol/backend/fixed_lag.hpp"

namespace idol {
FixedLag::ActivePrior::ActivePrior(MarginalPrior of)
    : prior(std::move(of)), information(gram(prior.rows().A)) {}

void FixedLag::add_prior(ChainSystem& system, const ActivePrior& active,
                         const std::vector<LineId>& ids) const {
  const MarginalPrior& prior = active.prior;
  const Eigen::MatrixXd& R = prior.rows().A;
  with_prior_variables([&](const PriorVariables& now) {
    const Eigen::VectorXd residual = R * prior.change(now) + prior.rows().b;
    const MarginalPrior::StateColumns T = prior.by_state(now);
    const Eigen::VectorXd g = R.transpose() * residual;
    const MarginalPrior::StateColumns HT = active.information * T;
    system.cost += 0.5 * residual.squaredNorm();
    system.diagonal[0] += T.transpose() * HT;
    system.state_gradient[0] += T.transpose() * g;
    // Where each four of its other variables stand, here and in the system.
    std::vector<std::pair<Eigen::Index, Eigen::Index>> columns;
    for (Eigen::Index k = 0; k < calibration_dim_; k += 4)
      columns.emplace_back(prior.calibration_column() + k, k);
    for (std::size_t k = 0; k < prior.lines().size(); ++k)
      columns.emplace_back(MarginalPrior::line_column(k), column_of(ids, prior.lines()[k].first));
    for (const auto& [row, to] : columns) {
      system.lines[0].at(to) += HT.middleRows<4>(row).transpose();
      system.line_gradient.segment<4>(to) += g.segment<4>(row);
      for (const auto& [column, beside] : columns)
        system.line_block.block<4, 4>(to, beside) += active.information.block<4, 4>(row, column);
    }
  });
}

// Lines that only the prior knows follow the rest of it.
void FixedLag::update_dormant_lines(const MarginalPrior::Reduction& reduction) {
  if (reduction.eliminated.empty()) return;
  const Eigen::VectorXd step = reduction.rest.given(
      with_prior_variables([&](const PriorVariables& now) { return reduction.prior.change(now); }));
  if (!step.allFinite()) return;
  for (std::size_t k = 0; k < reduction.eliminated.size(); ++k) {
    const auto& [id, at] = reduction.eliminated[k];
    Track& track = tracks_.at(id);
    track.line.coordinates = at + step.segment<4>(4 * static_cast<Eigen::Index>(k));
    track.dead = track.dead || !track.line.finite();
  }
}

// IMU, bias walk and stationarity between the first two states, whose columns begin at 0 and `next`.
void FixedLag::add_inertial_rows(RowStack& rows, std::size_t window, Eigen::Index next) const {
  const WindowRows w = window_rows(window);
  const Mat9& whitening = inertial_[window]->whitening;
  const Eigen::MatrixXd by_imu = whitening * w.imu.d_from.middleCols<6>(9) * inertial_[window]->by_intrinsics;
  rows.add({{0, whitening * w.imu.d_from},
            {next - imu_dim_, by_imu.leftCols(imu_dim_)},
            {next, whitening * w.imu.d_to}},
           whitening * w.imu.value);
  const Eigen::Matrix<double, 8, 1> walk = w.walk_weight.cwiseSqrt();
  rows.add({{9, -Eigen::MatrixXd(walk.asDiagonal())}, {next + 9, Eigen::MatrixXd(walk.asDiagonal())}},
           walk.cwiseProduct(w.walk));
  if (w.rest_weight > 0) {
    const double root = std::sqrt(w.rest_weight);
    rows.add({{6, root * Mat3::Identity()}}, root * states_[window].v_w);
  }
  if (w.rest_turn_weight > 0) {
    const double root = std::sqrt(w.rest_turn_weight);
    const Mat3 to = right_jacobian_inverse(w.turn);
    rows.add({{3, -root * to.transpose()}, {next + 3, root * to}}, root * w.turn);
  }
}

// What the window saw of the lines `ids`, over [old state, lines, calibration, ...]. Each line's many rows
// are first reduced to those about the line, at most four, and others about state and calibration alone,
// which then are reduced together.
void FixedLag::add_line_rows(RowStack& rows, std::size_t window, const std::vector<LineId>& ids) const {
  const std::vector<SightSystem> sights = sight_systems(window);
  const Eigen::Index others = calibration_dim_ + kStateDim, width = 4 + others + 1;
  const auto add = [&](Eigen::Ref<const Eigen::MatrixXd> block, Eigen::Index line_column,
                       Eigen::Index line_width) {
    const auto calibration = block.middleCols(line_width, calibration_dim_);
    const auto state = block.middleCols(line_width + calibration_dim_, kStateDim);
    rows.add({{line_column, block.leftCols(line_width)},
              {kStateDim + 4 * std::ssize(ids), calibration},
              {0, state}},
             block.rightCols<1>());
  };
  Eigen::MatrixXd shared(0, others + 1);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const Track& track = tracks_.at(ids[k]);
    std::vector<Eigen::Matrix<double, 2, Eigen::Dynamic>> seen_rows;
    for (const auto& seen : track.seen) {
      if (seen.window != window || seen.rejected) continue;
      for (const LineBin& bin : seen.bins) {
        const BinResidual r = residual(bin, track.line, window);
        if (!r.valid) continue;
        const double root = std::sqrt(robust(bin, r.value).second);
        Eigen::Matrix<double, 2, Eigen::Dynamic>& row = seen_rows.emplace_back(2, width);
        const SightSystem& sight = sights[static_cast<std::size_t>(bin.slot)];
        row << r.d_line, r.d_calibration.leftCols(camera_dim_),
            (r.d_camera * sight.by_imu).leftCols(imu_dim_), r.d_camera * sight.by_state, r.value;
        row *= root;
      }
    }
    if (seen_rows.empty()) continue;
    Eigen::MatrixXd block(2 * std::ssize(seen_rows), width);
    for (std::size_t i = 0; i < seen_rows.size(); ++i)
      block.middleRows<2>(2 * static_cast<Eigen::Index>(i)) = seen_rows[i];
    replace_by_triangular_factor(block);
    const Eigen::Index about_line = std::min<Eigen::Index>(4, block.rows()), rest = block.rows() - about_line;
    add(block.topRows(about_line), kStateDim + MarginalPrior::line_column(k), 4);
    shared.conservativeResize(shared.rows() + rest, Eigen::NoChange);
    shared.bottomRows(rest) = block.bottomRightCorner(rest, others + 1);
  }
  replace_by_triangular_factor(shared);
  add(shared, 0, 0);
}

// The oldest state and all that was seen from it become part of the prior. Lines that no later window has
// seen come first, the longest unseen of them before the others: they are the next to be eliminated.
void FixedLag::marginalise_oldest() {
  std::vector<LineId> ids;
  for (const auto& [id, at] : prior_.lines()) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  RowStack rows;
  std::vector<LineId> fresh;
  for (auto& [id, track] : tracks_)
    if (track.mapped && !track.dead && !std::binary_search(ids.begin(), ids.end(), id) &&
        std::any_of(track.seen.begin(), track.seen.end(),
                    [&](const Observation& o) { return o.window == first_ && !o.rejected; }))
      fresh.push_back(id);
  ids.insert(ids.end(), fresh.begin(), fresh.end());
  const auto seen_later = [&](LineId id) {
    const auto& seen = tracks_.at(id).seen;
    return std::any_of(seen.begin(), seen.end(), [&](const Observation& o) { return o.window > first_; });
  };
  std::sort(ids.begin(), ids.end(), [&](LineId a, LineId b) {
    const auto key = [&](LineId id) { return std::tuple(seen_later(id), tracks_.at(id).last_window, id); };
    return key(a) < key(b);
  });

  const Eigen::Index calibration = kStateDim + 4 * std::ssize(ids), next = calibration + calibration_dim_;
  const auto column_in_rows = [&](LineId id) {
    return kStateDim + 4 * (std::find(ids.begin(), ids.end(), id) - ids.begin());
  };
  with_prior_variables([&](const PriorVariables& now) {
    const LeastSquaresRows before = prior_.linearised(now);
    Eigen::MatrixXd lines = Eigen::MatrixXd::Zero(before.A.rows(), 4 * std::ssize(ids));
    for (std::size_t k = 0; k < prior_.lines().size(); ++k)
      lines.middleCols<4>(column_in_rows(prior_.lines()[k].first) - kStateDim) =
          before.A.middleCols<4>(MarginalPrior::line_column(k));
    rows.add({{0, before.A.rightCols<kStateDim>()},
              {kStateDim, lines},
              {calibration, before.A.middleCols(prior_.calibration_column(), calibration_dim_)}},
             before.b);
  });
  for (const LineId id : fresh)
    rows.add({{column_in_rows(id), kLeastInformation * Eigen::Matrix4d::Identity()}}, Vec4::Zero());
  add_inertial_rows(rows, first_, next);
  add_line_rows(rows, first_, ids);
  add_tie_rows(rows, first_, ids);

  std::vector<TimedCamera>().swap(inertial_[first_]->cameras);
  windows_[first_].imu.reset();
  ++first_;
  std::vector<std::pair<LineId, Vec4>> lines;
  for (LineId id : ids) lines.emplace_back(id, tracks_.at(id).line.coordinates);
  prior_ = marginalise(rows.stacked(next + kStateDim), states_[first_], calibration_, std::move(lines));
  for (auto& [id, track] : tracks_) {
    // In the order of windows; pieces of a line give it several observations in one.
    const auto active = std::find_if(track.seen.begin(), track.seen.end(),
                                     [&](const Observation& o) { return o.window >= first_; });
    for (auto seen = track.seen.begin(); seen != active; ++seen) track.past.emplace_back(*seen);
    track.seen.erase(track.seen.begin(), active);
  }
  if (!keeps_past()) drop_past();
}

FixedLag::PastObservation::PastObservation(const Observation& seen)
    : window_(static_cast<std::uint32_t>(seen.window)), rejected_(seen.rejected) {
  bins_.reserve(seen.bins.size());
  for (const LineBin& bin : seen.bins) {
    Bin& out = bins_.emplace_back(Bin{{}, bin.slot, bin.count});
    std::size_t k = 0;
    for (const Vec2* v : {&bin.a_px, &bin.b_px, &bin.a_heading, &bin.b_heading})
      for (const double x : *v) out.px[k++] = static_cast<float>(x);
    out.px[k] = static_cast<float>(bin.scatter_px);
  }
}

FixedLag::Observation FixedLag::PastObservation::observation() const {
  Observation out{window_, {}, rejected_};
  for (const Bin& bin : bins_) {
    const auto at = [&](std::size_t k) { return Vec2(bin.px[k], bin.px[k + 1]); };
    out.bins.push_back({at(0), at(2), at(4), at(6), bin.slot, bin.count, bin.px[8]});
  }
  return out;
}

// Only the states stay: memory hardly grows with the length of a run. (Assigning {} to a vector would keep
// it.)
void FixedLag::drop_past() {
  for (auto& [id, track] : tracks_) std::vector<PastObservation>().swap(track.past);
  for (; dropped_ < first_; ++dropped_) {
    windows_[dropped_].imu.reset();  // of a window left behind by a restart
    inertial_[dropped_].reset();
  }
}

// Dead lines leave the prior, and the longest unseen ones beyond the number that is kept.
void FixedLag::forget() {
  std::vector<std::pair<std::size_t, LineId>> resting;  // by when they were last seen
  for (const auto& [id, at] : prior_.lines())
    if (tracks_.at(id).seen.empty()) resting.emplace_back(tracks_.at(id).last_window, id);
  std::sort(resting.begin(), resting.end());
  const auto keep = static_cast<std::size_t>(options_.max_resting_lines);
  std::vector<LineId> old;
  for (std::size_t k = 0; k + keep < resting.size(); ++k) old.push_back(resting[k].second);
  std::vector<LineId> kept;
  for (const auto& [id, at] : prior_.lines())
    if (!tracks_.at(id).dead && std::find(old.begin(), old.end(), id) == old.end()) kept.push_back(id);
  if (kept.size() == prior_.lines().size()) return;
  std::sort(kept.begin(), kept.end());
  MarginalPrior::Reduction reduction = prior_.reduced(kept);
  archive(reduction, old);
  prior_ = std::move(reduction.prior);
}

}  // namespace idol
