#include "idol/odometry/gyro_offset.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

namespace idol {
namespace {

constexpr double kWidest = 0.15, kStep = 0.005;  // offsets looked at: up to which, at which distance [s]
constexpr int kSteps = 61;                       // from -kWidest to kWidest
constexpr std::size_t kFewestLines = 6, kFewestWindows = 8;

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

// Speed of one point across its line, and how it depends on the camera's rate and on its velocity over the
// depth [1/s].
struct Row {
  Vec6 by_motion;
  double speed;
};

Row row_at(const MovingLine& line, double u, const Camera& camera) {
  const Vec2 px = line.point(u, line.time);
  const Vec2 across(-line.direction.y(), line.direction.x());
  const double slope = line.c[1], length = std::sqrt(1 + slope * slope);
  const Vec2 normal = (across - slope * line.direction) / length;
  // In normalised coordinates: an edge's normal there, and the speed along it.
  const double scale = 1 / normal.cwiseProduct(Vec2(camera.fx, camera.fy)).norm();
  const Vec2 p = camera.normalise(px);
  const Vec2 m = normal.cwiseProduct(Vec2(camera.fx, camera.fy)) * scale;
  const double x = p.x(), y = p.y();
  Row row;
  row.by_motion << m.x() * x * y + m.y() * (1 + y * y), -m.x() * (1 + x * x) - m.y() * x * y,
      m.x() * y - m.y() * x, -m.x(), -m.y(), m.dot(p);
  row.speed = (line.c[2] + line.c[3] * u) / length * scale;
  return row;
}

// Integral of the rates from the first sample on, by the trapezoid rule.
class Turned {
 public:
  explicit Turned(std::span<const CameraRate> rates) : rates_(rates), sums_(rates.size(), Vec3::Zero()) {
    for (std::size_t k = 1; k < rates.size(); ++k)
      sums_[k] = sums_[k - 1] +
                 0.5 * seconds_between(rates[k - 1].t, rates[k].t) * (rates[k - 1].omega + rates[k].omega);
  }
  [[nodiscard]] Vec3 mean(Time from, Time to) const {
    return (at(to) - at(from)) / seconds_between(from, to);
  }

 private:
  [[nodiscard]] Vec3 at(Time t) const {
    const auto after = std::upper_bound(rates_.begin() + 1, rates_.end() - 1, t,
                                        [](Time value, const CameraRate& r) { return value < r.t; });
    const auto k = static_cast<std::size_t>(after - rates_.begin());
    const double share = seconds_between(rates_[k - 1].t, t) / seconds_between(rates_[k - 1].t, rates_[k].t);
    return sums_[k - 1] + share * (sums_[k] - sums_[k - 1]);
  }

  std::span<const CameraRate> rates_;
  std::vector<Vec3> sums_;
};

}  // namespace

void GyroOffset::add(const EventWindow& window, std::span<const Segment> segments) {
  if (segments.size() < kFewestLines) return;
  // A line's speed errs by some pixels per second, and, for what the model leaves out, by a share of itself.
  constexpr double kSpeed = 8, kShare = 0.1;       // [px/s]
  constexpr double kMostRate = 10, kMostFlow = 3;  // standard deviations of what may be [rad/s], [1/s]
  constexpr int kRounds = 6;
  std::vector<Row> rows;
  for (const Segment& segment : segments)
    for (const double share : {0.1, 0.9})
      rows.push_back(row_at(segment.line, segment.line.u_min + share * segment.line.length_px(), camera_));
  const double floor = kSpeed / camera_.fx;
  Vec6 prior;
  prior << Vec3::Constant(1 / (kMostRate * kMostRate)), Vec3::Constant(1 / (kMostFlow * kMostFlow));
  Vec6 motion = Vec6::Zero();
  Mat6 H;
  double squares = 0;
  for (int round = 0; round < kRounds; ++round) {
    H = prior.asDiagonal();
    Vec6 g = Vec6::Zero();
    squares = 0;
    for (const Row& row : rows) {
      const double variance = std::pow(floor + kShare * std::abs(row.speed), 2);
      const double error = row.speed - row.by_motion.dot(motion);
      // Both ends of a line count as one.
      const double weight = 0.5 / variance / (round == 0 ? 1 : 1 + error * error / variance);
      H += weight * row.by_motion * row.by_motion.transpose();
      g += weight * row.speed * row.by_motion;
      squares += weight * error * error;
    }
    motion = H.ldlt().solve(g);
  }
  const double freedom = std::max(1.0, static_cast<double>(segments.size()) - 6);
  const double spread = std::max(1.0, 2 * squares / freedom);
  const Mat3 cross = H.topRightCorner<3, 3>();
  const Mat3 information =
      H.topLeftCorner<3, 3>() - cross * H.bottomRightCorner<3, 3>().ldlt().solve(cross.transpose());
  turns_.push_back({window.begin, window.end, motion.head<3>(), information / spread});
}

void GyroOffset::drop_before(Time t) {
  while (!turns_.empty() && turns_.front().begin < t) turns_.pop_front();
}

std::optional<GyroOffset::Result> GyroOffset::search(std::span<const CameraRate> rates) const {
  constexpr double kBias = 0.05;  // standard deviation of the gyro's [rad/s]
  constexpr double kLimit = 9;    // squared error, in sigmas, from which a window counts less
  constexpr int kRounds = 4;
  if (rates.size() < 2) return std::nullopt;
  const Time widest = from_seconds(kWidest);
  std::vector<Turn> turns;
  for (const Turn& turn : turns_)
    if (turn.begin - widest >= rates.front().t && turn.end + widest <= rates.back().t) turns.push_back(turn);
  if (turns.size() < kFewestWindows) return std::nullopt;
  const Turned turned(rates);
  std::vector<double> costs;
  std::vector<Vec3> read(turns.size());
  for (int k = 0; k < kSteps; ++k) {
    const Time offset = from_seconds((k - kSteps / 2) * kStep);
    for (std::size_t i = 0; i < turns.size(); ++i)
      read[i] = turned.mean(turns[i].begin + offset, turns[i].end + offset);
    Vec3 bias = Vec3::Zero();
    double cost = 0;
    for (int round = 0; round < kRounds; ++round) {
      Mat3 H = Mat3::Identity() / (kBias * kBias);
      Vec3 g = Vec3::Zero();
      cost = bias.squaredNorm() / (kBias * kBias);
      for (std::size_t i = 0; i < turns.size(); ++i) {
        const Vec3 beside = read[i] - turns[i].omega, error = beside - bias;
        const double square = error.dot(turns[i].information * error), weight = 1 / (1 + square / kLimit);
        H += weight * turns[i].information;
        g += weight * turns[i].information * beside;
        cost += kLimit * std::log1p(square / kLimit);
      }
      bias = H.ldlt().solve(g);
    }
    costs.push_back(cost);
  }
  const auto best = std::min_element(costs.begin(), costs.end());
  const auto k = best - costs.begin();
  Result result{(static_cast<double>(k) - kSteps / 2) * kStep, costs[kSteps / 2], *best, false};
  if (k == 0 || k == kSteps - 1) return result;
  const double left = best[-1], right = best[1], bend = left - 2 * *best + right;
  if (bend > 0) result.offset_s += 0.5 * kStep * (left - right) / bend;
  // Of five times two sigmas, since neighbouring windows' errors are alike, and of the costs far from the
  // best.
  constexpr double kRise = 20, kShare = 0.3;
  const double rise =
      std::min(*std::max_element(costs.begin(), best), *std::max_element(best, costs.end())) - *best;
  const double most = *std::max_element(costs.begin(), costs.end()) - *best;
  result.distinct = rise > kRise && rise > kShare * most;
  return result;
}

bool GyroOffset::Result::wrong_here() const {
  constexpr double kFar = 0.025;  // [s]
  constexpr double kGain = 20, kShare = 0.2;
  const double gain = cost_here - cost_best;
  return distinct && std::abs(offset_s) > kFar && gain > kGain && gain > kShare * cost_here;
}

}  // namespace idol
