#include "idol/frontend/moving_line.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <iterator>
#include <limits>

#include "idol/base/lie.hpp"
#include "idol/base/wide.hpp"

namespace idol {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

constexpr std::size_t kDoubles = 4;
using Doubles [[gnu::vector_size(kDoubles * sizeof(double))]] = double;
using Mask [[gnu::vector_size(kDoubles * sizeof(double))]] = std::int64_t;

// Events relative to the line's origin and time, filled up to whole registers with some that no gate lets in.
struct Columns {
  std::vector<double> x, y, t;
  Columns(std::span<const TimedPixel> events, const MovingLine& line) {
    const std::size_t n = (events.size() + kDoubles - 1) / kDoubles * kDoubles;
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    x.resize(n, kNone), y.resize(n, kNone), t.resize(n, kNone);
    for (std::size_t i = 0; i < events.size(); ++i) {
      x[i] = events[i].x() - line.origin.x();
      y[i] = events[i].y() - line.origin.y();
      t[i] = events[i].z() - line.time;
    }
  }
};

// Sums of the model's terms, to the powers of u and t, over the events inside the gate.
struct Sums {
  Doubles n{}, u{}, t{}, uu{}, ut{}, tt{}, uuu{}, uut{}, utt{}, ttt{}, uuuu{}, uuut{}, uutt{}, uttt{}, tttt{};
  Doubles w{}, wu{}, wt{}, wut{}, wtt{}, wuu{}, ww{};
};

// `u`: of each event, NaN where it is left out.
IDOL_WIDE void add_up(const Columns& events, const MovingLine& line, double gate, Sums& out,
                      std::vector<double>& along) {
  const double dx = line.direction.x(), dy = line.direction.y();
  const double c0 = line.c[0], c1 = line.c[1], c2 = line.c[2], c3 = line.c[3], c4 = line.c[4];
  Sums sums;
  for (std::size_t i = 0; i < events.x.size(); i += kDoubles) {
    Doubles x, y, all_t;
    std::memcpy(&x, &events.x[i], sizeof x);
    std::memcpy(&y, &events.y[i], sizeof y);
    std::memcpy(&all_t, &events.t[i], sizeof all_t);
    const Doubles all_u = dx * x + dy * y, all_w = dx * y - dy * x;
    const Doubles off = all_w - (c0 + c1 * all_u + (c2 + c3 * all_u + c4 * all_t) * all_t);
    const Mask in = (off <= gate) & (off >= -gate);
    const auto u = (Doubles)((Mask)all_u & in), t = (Doubles)((Mask)all_t & in),
               w = (Doubles)((Mask)all_w & in);
    const Mask marked = (Mask)u | ~in;  // all bits are a NaN
    std::memcpy(&along[i], &marked, sizeof marked);
    const Doubles uu = u * u, ut = u * t, tt = t * t;
    sums.n -= __builtin_convertvector(in, Doubles);
    sums.u += u, sums.t += t, sums.uu += uu, sums.ut += ut, sums.tt += tt;
    sums.uuu += uu * u, sums.uut += uu * t, sums.utt += ut * t, sums.ttt += tt * t;
    sums.uuuu += uu * uu, sums.uuut += uu * ut, sums.uutt += ut * ut, sums.uttt += ut * tt;
    sums.tttt += tt * tt;
    sums.w += w, sums.wu += w * u, sums.wt += w * t, sums.wut += w * ut, sums.wtt += w * tt;
    sums.wuu += w * uu, sums.ww += w * w;
  }
  out = sums;
}

double sum(const Doubles& lanes) { return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]); }

// Normal equations of the model's terms (1, u, t, ut, t^2, u^2), the last of which only measures the bow.
struct Normal {
  Mat6 H;
  Vec6 b;
  double squares;
  explicit Normal(const Sums& s) : squares(sum(s.ww)) {
    const double uut = sum(s.uut), utt = sum(s.utt), ut = sum(s.ut), uu = sum(s.uu), tt = sum(s.tt);
    const double u = sum(s.u), t = sum(s.t), uutt = sum(s.uutt), uuut = sum(s.uuut), uttt = sum(s.uttt);
    const double ttt = sum(s.ttt), uuu = sum(s.uuu);
    H << sum(s.n), u, t, ut, tt, uu,            //
        u, uu, ut, uut, utt, uuu,               //
        t, ut, tt, utt, ttt, uut,               //
        ut, uut, utt, uutt, uttt, uuut,         //
        tt, utt, ttt, uttt, sum(s.tttt), uutt,  //
        uu, uuu, uut, uuut, uutt, sum(s.uuuu);
    b << sum(s.w), sum(s.wu), sum(s.wt), sum(s.wut), sum(s.wtt), sum(s.wuu);
  }
};

}  // namespace

double MovingLine::along(const TimedPixel& event) const { return direction.dot(event.head<2>() - origin); }

double MovingLine::distance(const TimedPixel& event) const {
  const double u = along(event);
  const double t = event.z() - time;
  const double slope = c[1] + c[3] * t;
  const double w = cross(direction, event.head<2>() - origin);
  return (w - (c[0] + c[1] * u + (c[2] + c[3] * u) * t + c[4] * t * t)) / std::sqrt(1 + slope * slope);
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
  for (const auto& e : events) mean += e;
  mean /= static_cast<double>(events.size());
  MovingLine line;
  line.origin = mean.head<2>();
  line.time = mean.z();
  line.direction = Eigen::Vector2d(normal.y(), -normal.x()).normalized();
  double gate = 1e9;
  const Columns columns(events, line);
  std::vector<double> along(columns.x.size());
  for (int round = 0; round < kRounds; ++round) {
    // Turn the frame onto the line found so far: the model is linear for small slopes only.
    line.direction =
        (line.direction + line.c[1] * Eigen::Vector2d(-line.direction.y(), line.direction.x())).normalized();
    line.c[1] = 0;
    Sums sums;
    add_up(columns, line, gate, sums, along);
    const auto [H, b, squares] = Normal(sums);
    const double n = H(0, 0);
    if (n < 8) return std::nullopt;
    // A little of the prior "no motion, no bend" keeps short spans from inventing them, and the matrix
    // positive definite.
    const Vec6 scale = (H.diagonal() / n).cwiseSqrt().cwiseMax(1e-12);
    const Vec6 inverse = scale.cwiseInverse();
    Mat6 Hs = inverse.asDiagonal() * H * inverse.asDiagonal();
    Hs.diagonal().array() += 1e-4 * n;
    const Vec6 bs = inverse.cwiseProduct(b);
    line.c = inverse.head<5>().cwiseProduct(Hs.topLeftCorner<5, 5>().llt().solve(bs.head<5>()));
    const double left = squares - 2 * line.c.dot(b.head<5>()) + line.c.dot(H.topLeftCorner<5, 5>() * line.c);
    line.rms_px = std::sqrt(std::max(0.0, left) / n);
    gate = std::clamp(2.5 * line.rms_px, 0.5 * gate_px, round == 0 ? 2 * gate_px : gate_px);
    if (round + 1 < kRounds) continue;
    std::vector<double> feet;
    feet.reserve(events.size());
    std::copy_if(along.begin(), along.end(), std::back_inserter(feet),
                 [](double u) { return !std::isnan(u); });
    // Without the outermost fiftieth at each end: of 120 events that is two, so that sorting those is the
    // quickest.
    const auto cut = static_cast<std::ptrdiff_t>(feet.size() / 50);
    std::partial_sort(feet.begin(), feet.begin() + cut + 1, feet.end());
    line.u_min = feet[static_cast<std::size_t>(cut)];
    std::partial_sort(feet.begin() + cut, feet.begin() + 2 * cut + 1, feet.end(), std::greater<>());
    line.u_max = feet[static_cast<std::size_t>(2 * cut)];
    line.bow_px = std::abs((Hs.llt().solve(bs))[5] * inverse[5]) * std::pow(line.length_px() / 2, 2);
  }
  return line;
}

}  // namespace idol
