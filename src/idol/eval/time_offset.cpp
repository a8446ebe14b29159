#include "idol/eval/time_offset.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "idol/base/diagnostics.hpp"

namespace idol {
namespace {

/// Speed over time, in steps of equal length from the trajectory's first stamp on.
std::vector<double> speeds(const Trajectory& trajectory, Time step, bool turning) {
  std::vector<double> out;
  Time at = trajectory.front().t;
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    const StampedPose &a = trajectory[i - 1], &b = trajectory[i];
    const double moved = turning ? quat_log(a.T.q.conjugate() * b.T.q).norm() : (b.T.p - a.T.p).norm();
    const double speed = moved / seconds_between(a.t, b.t);
    for (; at < b.t; at += step) out.push_back(speed);
  }
  return out;
}

struct Resemblance {
  double correlation = -1;
  std::ptrdiff_t shift = 0;
};

/// The best a[i] ~ b[i + shift] with shift in [from, to].
Resemblance best_resemblance(const std::vector<double>& a, const std::vector<double>& b, std::ptrdiff_t from,
                             std::ptrdiff_t to) {
  const auto n = std::ssize(a), m = std::ssize(b);
  const std::ptrdiff_t least = std::min(n, m) / 2;
  Resemblance best;
  for (std::ptrdiff_t shift = from; shift <= to; ++shift) {
    const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, -shift), end = std::min(n, m - shift);
    if (end - begin < least || end <= begin) continue;
    double sa = 0, sb = 0, aa = 0, bb = 0, ab = 0;
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      const double x = a[static_cast<std::size_t>(i)], y = b[static_cast<std::size_t>(i + shift)];
      sa += x, sb += y, aa += x * x, bb += y * y, ab += x * y;
    }
    const auto count = static_cast<double>(end - begin);
    const double va = aa - sa * sa / count, vb = bb - sb * sb / count;
    const double correlation = va > 0 && vb > 0 ? (ab - sa * sb / count) / std::sqrt(va * vb) : 0;
    if (correlation > best.correlation) best = {correlation, shift};
  }
  return best;
}

bool has_orientation(const Trajectory& t) { return t.front().T.q.coeffs().allFinite(); }

}  // namespace

Time find_time_offset(const Trajectory& estimate, const Trajectory& truth) {
  constexpr std::size_t kFewest = 10;
  if (estimate.size() < kFewest || truth.size() < kFewest)
    throw DataError("too few poses to find the time between two clocks from; give it in seconds");
  const bool turning = has_orientation(estimate) && has_orientation(truth);
  const Time longest = std::max(estimate.back().t - estimate.front().t, truth.back().t - truth.front().t);
  // Coarse over everything, then in milliseconds around the best.
  constexpr Time kMillisecond = 1'000'000, kMostSteps = 4000;
  const Time coarse = std::max(10 * kMillisecond, longest / kMostSteps);
  const auto a = speeds(estimate, coarse, turning), b = speeds(truth, coarse, turning);
  const Resemblance rough = best_resemblance(a, b, -std::ssize(a), std::ssize(b));
  constexpr double kSure = 0.6;
  if (rough.correlation < kSure)
    throw DataError(fmt::format(
        "the two motions resemble each other nowhere (correlation {:.2f} at best): no time offset can "
        "be found; are they of one recording?",
        rough.correlation));
  const auto a_fine = speeds(estimate, kMillisecond, turning), b_fine = speeds(truth, kMillisecond, turning);
  const auto around = static_cast<std::ptrdiff_t>(rough.shift * (coarse / kMillisecond));
  const auto margin = static_cast<std::ptrdiff_t>(2 * coarse / kMillisecond);
  const Resemblance fine = best_resemblance(a_fine, b_fine, around - margin, around + margin);
  return truth.front().t - estimate.front().t + Time{fine.shift} * kMillisecond;
}

Trajectory shifted(Trajectory trajectory, Time offset) {
  for (StampedPose& pose : trajectory) pose.t += offset;
  return trajectory;
}

}  // namespace idol
