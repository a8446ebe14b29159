// The lines of the fixed lag: how they begin, how they are known again, how far they reach.
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "idol/backend/fixed_lag.hpp"
#include "idol/base/median.hpp"

namespace idol {
namespace {

constexpr double kNearPx = 1e-6;
constexpr int kMoreToSettle = 2;  // times as many lines of unknown depth, until the velocity is known

}  // namespace

// A mapped line whose image is where the segment is: both ends within the gate, most of the segment inside
// the line's extent, and no second line as near.
std::optional<LineId> FixedLag::known_line(const LineObservation& seen, std::size_t window) const {
  const NavState& state = states_[window];
  const ImuBias& bias = windows_[window].bias;
  std::optional<LineId> best;
  double nearest = options_.redetect_px, second = 1e9;
  const Vec2 from = seen.end_a.px, to = seen.end_b.px;
  for (const auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead || track.archived || !track.line.finite()) continue;
    const Line line = line_of(id, track);
    const TimedCamera camera(state, later(seen.end_a.motion, state.time_shift), bias, projection_);
    const Vec3 a = camera({line.a}).x, b = camera({line.b}).x;
    if (a.z() < 0.05 || b.z() < 0.05) continue;
    const Vec2 pa = projection_.camera.project(a), pb = projection_.camera.project(b);
    const double length = (pb - pa).norm();
    if (length < kNearPx) continue;
    const Vec2 along = (pb - pa) / length, across(-along.y(), along.x());
    const double distance = std::max(std::abs(across.dot(from - pa)), std::abs(across.dot(to - pa)));
    if (distance > 3 * options_.redetect_px) continue;
    const double u0 = along.dot(from - pa), u1 = along.dot(to - pa);
    const double overlap = std::min(std::max(u0, u1), length) - std::max(std::min(u0, u1), 0.0);
    if (overlap < 0.5 * std::min(std::abs(u1 - u0), length)) continue;
    if (distance < nearest) {
      second = best ? nearest : second;
      nearest = distance;
      best = id;
    } else {
      second = std::min(second, distance);
    }
  }
  if (best && second < 1.5 * nearest + 0.5) return std::nullopt;
  return best;
}

double FixedLag::typical_depth() const {
  const Pose T_c_w = (states_.back().T_w_i * projection_.T_i_c).inverse();
  std::vector<double> depths;
  for (const auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead || track.seen.empty() || !track.line.finite()) continue;
    const LineEnds ends = track.line.ends();
    const double z = (T_c_w * Vec3(0.5 * (ends.a + ends.b))).z();
    if (z > 0.1) depths.push_back(z);
  }
  return depths.size() < 3 ? options_.first_depth_m : percentile(depths, 0.5);
}

void FixedLag::make_lines() {
  const bool few = std::ssize(active_lines()) < (settled_ ? 1 : kMoreToSettle) * options_.few_lines;
  for (auto& [id, track] : tracks_) {
    if (!track.sure || track.mapped || track.dead || track.seen.empty() ||
        track.last_window + 1 != windows_.size() || std::ssize(track.seen) < options_.min_windows)
      continue;
    track.mapped = triangulate(track) || (few && initialise_with_depth_prior(track));
  }
  for (auto& [id, track] : tracks_)
    if (track.depth_prior && !track.seen.empty() && knows_depth(track.line, line_information(track)))
      track.depth_prior.reset();
  // Segments that ended before they could become lines.
  std::erase_if(tracks_,
                [&](const auto& entry) { return !entry.second.mapped && entry.second.seen.empty(); });
}

// The camera in the world when that was measured.
Pose FixedLag::camera_at(std::size_t window, const EventMeasurement& measured) const {
  const NavState& state = states_[window];
  return predict(state, later(measured.motion, state.time_shift), windows_[window].bias, projection_.gravity)
             .T_w_i *
         projection_.T_i_c;
}

// Through the newest observation.
AnchoredLine FixedLag::new_line(const Track& track, double depth) const {
  AnchoredLine line;
  line.anchor = LineAnchor::from_image(camera_at(track.seen.back().window, track.end_a), track.end_a.px,
                                       track.end_b.px, projection_.camera);
  line.coordinates = Vec4(0, 1 / depth, 0, 1 / depth);
  return line;
}

// Gauss-Newton on the line alone, poses fixed, with `prior` information about its first coordinates. Returns
// the information in the end; false if it cannot be solved.
bool FixedLag::fit(const Track& track, const Eigen::Matrix4d& prior, AnchoredLine& line, Eigen::Matrix4d& H,
                   double& rms) const {
  constexpr int kIterations = 6;
  const Vec4 first = line.coordinates;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    H = prior;
    Vec4 g = prior * (line.coordinates - first);
    double squares = 0;
    int rows = 0;
    for (const auto& seen : track.seen)
      for (const auto& bin : seen.bins) {
        const BinResidual r = residual(bin, line, seen.window);
        if (!r.valid) continue;
        const double weight = 1 / std::pow(sigma_px(bin), 2);
        H += weight * r.d_line.transpose() * r.d_line;
        g += weight * r.d_line.transpose() * r.value;
        squares += r.value.squaredNorm() / std::pow(widening(bin), 2);
        rows += 2;
      }
    rms = std::sqrt(squares / std::max(1, rows));
    const Vec4 step = H.ldlt().solve(-g);
    if (!step.allFinite()) return false;
    line.move(step);
  }
  return true;
}

// From several depths. Accepted once the bins agree on it and say how far it is: the parallax must leave the
// line's own plane.
bool FixedLag::triangulate(Track& track) const {
  const double typical = typical_depth();
  for (double factor : {1.0, 0.5, 2.0}) {
    AnchoredLine line = new_line(track, factor * typical);
    Eigen::Matrix4d H;
    double rms = 0;
    if (!fit(track, Eigen::Matrix4d::Zero(), line, H, rms) || !(rms < options_.create_rms_px)) continue;
    const double rho = 0.5 * (line.coordinates[1] + line.coordinates[3]);
    if (!line.finite() || !knows_depth(line, H)) continue;
    if (line.coordinates[1] < 0.2 * rho || line.coordinates[3] < 0.2 * rho) continue;
    track.line = line;
    return true;
  }
  return false;
}

// By the standard deviation of the mean inverse depth of both ends, given the poses.
bool FixedLag::knows_depth(const AnchoredLine& line, const Eigen::Matrix4d& information) const {
  const Eigen::Matrix4d covariance = information.inverse();
  const double variance = covariance(1, 1) + covariance(3, 3) + 2 * covariance(1, 3);
  const double rho = 0.5 * (line.coordinates[1] + line.coordinates[3]);
  return variance >= 0 && 0.5 * std::sqrt(variance) < options_.create_depth_sigma * rho;
}

// What the active windows say about a line's coordinates, poses fixed.
Eigen::Matrix4d FixedLag::line_information(const Track& track) const {
  Eigen::Matrix4d H = Eigen::Matrix4d::Zero();
  for (const auto& seen : track.seen)
    for (const auto& bin : seen.bins)
      if (const BinResidual r = residual(bin, track.line, seen.window); r.valid)
        H += r.d_line.transpose() * r.d_line / std::pow(sigma_px(bin), 2);
  return H;
}

// While there is hardly a map, lines of unknown depth hold the rotation, and get their depth together with
// the velocity, with a weak prior about the typical depth.
bool FixedLag::initialise_with_depth_prior(Track& track) const {
  AnchoredLine line = new_line(track, typical_depth());
  DepthPrior prior{line.coordinates};
  const double sigma = options_.depth_prior_log * line.coordinates[1],
               slant = options_.slant_prior_log * line.coordinates[1];
  prior.whitening(0, 1) = prior.whitening(1, 3) = 1 / sigma;
  prior.whitening(2, 1) = 1 / slant;
  prior.whitening(2, 3) = -1 / slant;
  Eigen::Matrix4d H;
  double rms = 0;
  if (!fit(track, prior.whitening.transpose() * prior.whitening, line, H, rms) ||
      !(rms < 2 * options_.create_rms_px) || !line.finite())
    return false;
  track.line = line;
  track.depth_prior = prior;
  return true;
}

// Where the rays through the ends of the newest observations meet the line, from the anchor's a on [m].
void FixedLag::measure_extents() {
  constexpr std::size_t kKept = 32;
  for (auto& [id, track] : tracks_) {
    if (!in_sight(track)) continue;
    const LineEnds ends = track.line.ends();
    const Vec3 along = (ends.b - ends.a).normalized();
    double u[2];
    for (int k = 0; k < 2; ++k) {
      const EventMeasurement& end = k == 0 ? track.end_a : track.end_b;
      const Pose T_w_c = camera_at(track.seen.back().window, end);
      const Vec2 m = projection_.camera.normalise(end.px);
      const Vec3 ray = (T_w_c.q * Vec3(m.x(), m.y(), 1)).normalized();
      // Point of the line nearest to the ray.
      const Vec3 off = T_w_c.p - ends.a;
      const double c = along.dot(ray), denominator = 1 - c * c;
      u[k] = denominator < 1e-4 ? 0 : (along.dot(off) - c * ray.dot(off)) / denominator;
    }
    track.low.push_back(std::min(u[0], u[1]));
    track.high.push_back(std::max(u[0], u[1]));
    if (track.low.size() > kKept) {
      track.low.erase(track.low.begin());
      track.high.erase(track.high.begin());
    }
    track.from = percentile(track.low, 0.1);
    track.to = percentile(track.high, 0.9);
  }
}

Line FixedLag::line_of(LineId id, const Track& track) const {
  Line line;
  line.id = id;
  const LineEnds ends = track.line.ends();
  const Vec3 along = (ends.b - ends.a).normalized();
  line.a = track.low.empty() ? ends.a : Vec3(ends.a + track.from * along);
  line.b = track.high.empty() ? ends.b : Vec3(ends.a + track.to * along);
  line.first = states_[track.first_window].t;
  line.last = states_[track.last_window + 1].t;
  line.windows = track.windows;
  line.events = track.events;
  return line;
}

}  // namespace idol
