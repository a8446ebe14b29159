#include "idol/frontend/moving_line.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/base/lie.hpp"

namespace idol {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;

// Terms of the model at an event; the sixth, u^2, only measures the bow.
Vec6 terms(const MovingLine& line, const TimedPixel& event) {
  const double u = line.along(event);
  const double t = event.z() - line.time;
  return (Vec6() << 1, u, t, u * t, t * t, u * u).finished();
}

double across(const MovingLine& line, const TimedPixel& event) {
  return cross(line.direction, event.head<2>() - line.origin);
}

}  // namespace

double MovingLine::along(const TimedPixel& event) const { return direction.dot(event.head<2>() - origin); }

double MovingLine::distance(const TimedPixel& event) const {
  const double u = along(event);
  const double t = event.z() - time;
  const double slope = c[1] + c[3] * t;
  return (across(*this, event) - (c[0] + c[1] * u + (c[2] + c[3] * u) * t + c[4] * t * t)) /
         std::sqrt(1 + slope * slope);
}

Eigen::Vector2d MovingLine::point(double u, double t_s) const {
  const double t = t_s - time;
  const double w = c[0] + c[1] * u + (c[2] + c[3] * u) * t + c[4] * t * t;
  return origin + u * direction + w * Eigen::Vector2d(-direction.y(), direction.x());
}

Eigen::Vector2d MovingLine::heading(double u, double t) const {
  constexpr double kSlow = 10;  // [px/s]
  const double v = c[2] + c[3] * u + 2 * c[4] * (t - time);
  return v / std::hypot(v, kSlow) * Eigen::Vector2d(-direction.y(), direction.x());
}

std::optional<MovingLine> fit_moving_line(std::span<const TimedPixel> events, const Eigen::Vector2d& normal,
                                          double gate_px) {
  constexpr int kRounds = 3;
  if (events.size() < 8) return std::nullopt;
  TimedPixel mean = TimedPixel::Zero();
  for (const auto& e : events) mean += e / static_cast<double>(events.size());
  MovingLine line;
  line.origin = mean.head<2>();
  line.time = mean.z();
  line.direction = Eigen::Vector2d(normal.y(), -normal.x()).normalized();
  double gate = 1e9;
  std::vector<double> feet;
  feet.reserve(events.size());
  Eigen::Matrix<double, 6, 6> H;
  Vec6 b;
  for (int round = 0; round < kRounds; ++round) {
    // Turn the frame onto the line found so far: the model is linear for small slopes only.
    line.direction =
        (line.direction + line.c[1] * Eigen::Vector2d(-line.direction.y(), line.direction.x())).normalized();
    line.c[1] = 0;
    H.setZero();
    b.setZero();
    feet.clear();
    double squares = 0;
    for (const auto& e : events) {
      const Vec6 a = terms(line, e);
      const double w = across(line, e);
      if (std::abs(w - line.c.dot(a.head<5>())) > gate) continue;
      H += a * a.transpose();
      b += a * w;
      squares += w * w;
      feet.push_back(a[1]);
    }
    if (feet.size() < 8) return std::nullopt;
    // A little of the prior "no motion, no bend" keeps short spans from inventing them.
    const double n = static_cast<double>(feet.size());
    const Vec6 scale = (H.diagonal() / n).cwiseSqrt().cwiseMax(1e-12);
    const Vec6 inverse = scale.cwiseInverse();
    Eigen::Matrix<double, 6, 6> Hs = inverse.asDiagonal() * H * inverse.asDiagonal();
    Hs.diagonal().array() += 1e-4 * n;
    const Vec6 bs = inverse.cwiseProduct(b);
    line.c = inverse.head<5>().cwiseProduct(Hs.topLeftCorner<5, 5>().ldlt().solve(bs.head<5>()));
    const double left = squares - 2 * line.c.dot(b.head<5>()) + line.c.dot(H.topLeftCorner<5, 5>() * line.c);
    line.rms_px = std::sqrt(std::max(0.0, left) / n);
    gate = std::clamp(2.5 * line.rms_px, 0.5 * gate_px, round == 0 ? 2 * gate_px : gate_px);
    if (round + 1 < kRounds) continue;
    const std::size_t cut = feet.size() / 50;
    const auto low = feet.begin() + static_cast<std::ptrdiff_t>(cut);
    const auto high = feet.end() - 1 - static_cast<std::ptrdiff_t>(cut);
    std::nth_element(feet.begin(), low, feet.end());
    line.u_min = *low;
    std::nth_element(low, high, feet.end());
    line.u_max = *high;
    line.bow_px = std::abs((Hs.ldlt().solve(bs))[5] * inverse[5]) * std::pow(line.length_px() / 2, 2);
  }
  return line;
}

}  // namespace idol
