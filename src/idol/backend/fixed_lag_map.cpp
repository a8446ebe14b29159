// The map of the fixed lag: lines that leave the problem are archived with their covariance; segments that
// are found to be archived lines tie the estimate to them.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"

namespace idol {
namespace {

// Errors that many archived lines share, the drift up to them above all, count once for each line that is
// tied to them: their covariance is inflated by this factor.
constexpr double kSharedErrors = 4;
constexpr double kTieScale = 9;  // of the Cauchy loss on a tie's squared residual of four rows

// The archived line and its covariance in the coordinates of another anchor.
std::optional<std::pair<Vec4, Eigen::Matrix4d>> transported(const ArchivedLine& source,
                                                            const LineAnchor& anchor) {
  const auto at = AnchoredLine::coordinates_of(source.line.ends(), anchor);
  if (!at) return std::nullopt;
  Eigen::Matrix4d J;
  for (int k = 0; k < 4; ++k) {
    constexpr double kStep = 1e-6;
    AnchoredLine moved = source.line;
    moved.coordinates[k] += kStep;
    const auto there = AnchoredLine::coordinates_of(moved.ends(), anchor);
    if (!there) return std::nullopt;
    J.col(k) = (*there - *at) / kStep;
  }
  return std::pair(*at, Eigen::Matrix4d(J * source.covariance * J.transpose()));
}

}  // namespace

// Only lines whose depth is known are worth finding again.
void FixedLag::archive(const MarginalPrior::Reduction& reduction, const std::vector<LineId>& ids) {
  constexpr int kFewestWindows = 5;
  constexpr double kDepthSigma = 0.1;  // relative
  if (ids.empty()) return;
  const Eigen::MatrixXd covariance = reduction.covariance();
  for (std::size_t k = 0; k < reduction.eliminated.size(); ++k) {
    const LineId id = reduction.eliminated[k].first;
    Track& track = tracks_.at(id);
    if (std::find(ids.begin(), ids.end(), id) == ids.end()) continue;
    track.archived = true;
    if (track.dead || track.windows < kFewestWindows || !track.line.finite() || track.low.empty()) continue;
    const auto row = 4 * static_cast<Eigen::Index>(k);
    ArchivedLine line{id, track.line, covariance.block<4, 4>(row, row), {}, 0};
    const Vec4& c = line.line.coordinates;
    if (!(std::sqrt(line.covariance(1, 1)) < kDepthSigma * c[1] &&
          std::sqrt(line.covariance(3, 3)) < kDepthSigma * c[3]))
      continue;
    const Line segment = line_of(id, track);
    line.ends = {segment.a, segment.b};
    line.distance_m = (0.5 * (segment.a + segment.b) - states_[track.last_window].T_w_i.p).norm();
    map_.insert(std::move(line));
  }
}

// Segments of the newest window that are not tied to the map yet. A pair counts once the same has been found
// in some windows in a row.
void FixedLag::associate_with_map() {
  constexpr int kInARow = 3;
  if (map_.size() == 0 || !covariance_) return;
  const NavState& now = states_.back();
  const std::size_t window = windows_.size() - 1;
  std::vector<ImageSegment> segments;
  for (const auto& [id, track] : tracks_)
    if (track.sure && !track.dead && !track.tie && !track.seen.empty() && track.last_window == window)
      segments.push_back({id, track.end_a.px, track.end_b.px, camera_at(window, track.end_a)});
  std::vector<MapSegment> lines;
  const Pose T_w_c = now.T_w_i * projection_.T_i_c;
  for (const ArchivedLine* line : map_.near(T_w_c.p))
    if (may_be_in_sight(line->ends, T_w_c, projection_.camera)) lines.push_back({line->id, line->ends});
  // Position and yaw.
  constexpr double kInflation = 4, kFloor = 0.01, kFloorYaw = 0.005;
  Eigen::Matrix<double, 4, 6> to_offset = Eigen::Matrix<double, 4, 6>::Zero();
  to_offset.topLeftCorner<3, 3>().setIdentity();
  to_offset.bottomRightCorner<1, 3>() = now.T_w_i.R().row(2);
  Eigen::Matrix4d covariance =
      kInflation * to_offset * covariance_->topLeftCorner<6, 6>() * to_offset.transpose();
  const double floor = kFloor * typical_depth();
  covariance.diagonal() += Vec4(floor * floor, floor * floor, floor * floor, kFloorYaw * kFloorYaw);
  const auto found = associate(segments, lines, projection_.camera, covariance);
  std::map<LineId, std::pair<LineId, int>> proposed;
  if (found)
    for (const LineMatch& match : found->matches) {
      const auto before = proposed_.find(match.segment);
      const bool same = before != proposed_.end() && before->second.first == match.line;
      proposed[match.segment] = {match.line, same ? before->second.second + 1 : 1};
    }
  proposed_ = std::move(proposed);
  for (const auto& [segment, proposal] : proposed_) {
    const ArchivedLine* line = map_.find(proposal.first);
    if (proposal.second >= kInARow && line != nullptr) (void)tie(segment, *line);
  }
}

// From now on the track is the archived line. One whose depth is not known gets it from the map.
bool FixedLag::tie(LineId id, const ArchivedLine& source) {
  constexpr double kInverseDepth = 0.005, kAcrossPx = 0.5;  // least sigmas: relative, and in the image
  Track& track = tracks_.at(id);
  AnchoredLine line = track.mapped ? track.line : new_line(track, 1);
  const auto there = transported(source, line.anchor);
  if (!there) return false;
  Eigen::Matrix4d covariance = kSharedErrors * there->second;
  const double across = kAcrossPx / projection_.camera.fx;
  for (int k = 0; k < 4; ++k)
    covariance(k, k) += std::pow(k % 2 == 0 ? across : kInverseDepth * there->first[k], 2);
  const Eigen::LLT<Eigen::Matrix4d> factor(covariance);
  if (factor.info() != Eigen::Success) return false;
  if (!track.mapped) {
    line.coordinates = there->first;
    track.line = line;
    track.mapped = true;
  }
  track.tie = {source, there->first, factor.matrixL().solve(Eigen::Matrix4d::Identity()), windows_.size() - 1,
               false};
  tracks_.at(source.id).continued = true;
  map_.erase(track.tie->source.id);
  return true;
}

// The track was not the archived line after all, or cannot say so.
void FixedLag::release(Track& track) {
  if (!track.tie || track.tie->in_prior) return;
  tracks_.at(track.tie->source.id).continued = false;
  map_.insert(std::move(track.tie->source));
  track.tie.reset();
}

std::pair<double, double> FixedLag::robust(const Vec4& tie_residual) {
  const double squared = tie_residual.squaredNorm();
  return {0.5 * kTieScale * std::log1p(squared / kTieScale), 1 / (1 + squared / kTieScale)};
}

// What is known of single lines beside their observations.
void FixedLag::add_line_factors(ChainSystem& system, const std::vector<LineId>& ids) const {
  for (const LineId id : ids) {
    const Track& track = tracks_.at(id);
    const Eigen::Index column = column_of(ids, id);
    const auto add = [&](double weight, const auto& whitening, const auto& residual) {
      system.line_block.block<4, 4>(column, column) += weight * whitening.transpose() * whitening;
      system.line_gradient.segment<4>(column) += weight * whitening.transpose() * residual;
    };
    if (track.tie && !track.tie->in_prior) {
      const Vec4 residual = track.tie->residual(track.line);
      const auto [cost, weight] = robust(residual);
      system.cost += cost;
      add(weight, track.tie->whitening, residual);
    }
    if (track.depth_prior) {
      const Vec3 residual = track.depth_prior->residual(track.line);
      system.cost += 0.5 * residual.squaredNorm();
      add(1, track.depth_prior->whitening, residual);
    }
  }
}

// Ties that all windows since have not contradicted become part of the prior.
void FixedLag::add_tie_rows(RowStack& rows, std::size_t window, const std::vector<LineId>& ids) {
  constexpr double kContradiction = 25;  // chi-square of four degrees of freedom, far beyond 99.99 %
  for (std::size_t k = 0; k < ids.size(); ++k) {
    Track& track = tracks_.at(ids[k]);
    if (!track.tie || track.tie->in_prior || track.tie->window > window) continue;
    const Vec4 residual = track.tie->residual(track.line);
    if (residual.squaredNorm() > kContradiction) {
      release(track);
      continue;
    }
    const double root = std::sqrt(robust(residual).second);
    rows.add({{kStateDim + MarginalPrior::line_column(k), root * track.tie->whitening}}, root * residual);
    track.tie->in_prior = true;
    const Track& source = tracks_.at(track.tie->source.id);
    track.first_window = source.first_window;
    track.windows += source.windows;
    track.events += source.events;
  }
}

}  // namespace idol
