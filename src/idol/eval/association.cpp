#include "idol/eval/association.hpp"

#include <algorithm>
#include <cmath>
#include <queue>
#include <tuple>
#include <utility>

#include "idol/base/median.hpp"

namespace idol {
namespace {

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

/// One stamp of either trajectory in the merged, doubly linked list of those not matched yet.
struct Stamp {
  double t = 0;
  std::size_t index = 0;
  bool groundtruth = false;
  bool used = false;
  std::size_t prev = kNone;
  std::size_t next = kNone;
};

std::vector<Stamp> merge_stamps(const Trajectory& estimate, const Trajectory& groundtruth) {
  std::vector<Stamp> stamps;
  stamps.reserve(estimate.size() + groundtruth.size());
  for (std::size_t i = 0; i < estimate.size(); ++i) stamps.push_back({stamp_seconds(estimate[i].t), i});
  for (std::size_t i = 0; i < groundtruth.size(); ++i)
    stamps.push_back({stamp_seconds(groundtruth[i].t), i, true});
  std::inplace_merge(stamps.begin(), stamps.begin() + static_cast<std::ptrdiff_t>(estimate.size()),
                     stamps.end(), [](const Stamp& a, const Stamp& b) { return a.t < b.t; });
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    stamps[i].prev = i == 0 ? kNone : i - 1;
    stamps[i].next = i + 1 == stamps.size() ? kNone : i + 1;
  }
  return stamps;
}

/// A pair that may be matched; the order is the order of matching.
struct Candidate {
  double difference = 0;
  Match match;
  std::size_t left = 0;
  std::size_t right = 0;

  bool operator>(const Candidate& o) const {
    return std::tie(difference, match.estimate, match.groundtruth) >
           std::tie(o.difference, o.match.estimate, o.match.groundtruth);
  }
};

void unlink(std::vector<Stamp>& stamps, std::size_t i) {
  stamps[i].used = true;
  if (stamps[i].prev != kNone) stamps[stamps[i].prev].next = stamps[i].next;
  if (stamps[i].next != kNone) stamps[stamps[i].next].prev = stamps[i].prev;
}

}  // namespace

double stamp_seconds(Time t) {
  // Up to 2^53 ns one division rounds correctly; beyond (Unix time) whole seconds and the rest do, since
  // no nanosecond lies closer than 4e-16 s to the middle between two such doubles without being it.
  constexpr Time kExact = Time{1} << 53;
  constexpr Time kSecond = 1'000'000'000;
  if (t > -kExact && t < kExact) return static_cast<double>(t) / kNsPerS;
  const Time whole = t / kSecond;
  return static_cast<double>(whole) + static_cast<double>(t % kSecond) / kNsPerS;
}

std::vector<Match> associate(const Trajectory& estimate, const Trajectory& groundtruth,
                             double max_difference_s) {
  // The closest pair of a sorted list is always a pair of neighbours: whatever stood between them would be
  // closer to one of them. So only neighbours are ever candidates, and each match creates at most one more.
  std::vector<Stamp> stamps = merge_stamps(estimate, groundtruth);
  std::priority_queue<Candidate, std::vector<Candidate>, std::greater<>> candidates;
  const auto offer = [&](std::size_t left, std::size_t right) {
    if (left == kNone || right == kNone || stamps[left].groundtruth == stamps[right].groundtruth) return;
    const double difference = std::abs(stamps[left].t - stamps[right].t);
    if (!(difference < max_difference_s)) return;
    const Stamp& e = stamps[left].groundtruth ? stamps[right] : stamps[left];
    const Stamp& g = stamps[left].groundtruth ? stamps[left] : stamps[right];
    candidates.push({difference, {e.index, g.index}, left, right});
  };
  for (std::size_t i = 0; i + 1 < stamps.size(); ++i) offer(i, i + 1);

  std::vector<Match> matches;
  while (!candidates.empty()) {
    const Candidate best = candidates.top();
    candidates.pop();
    if (stamps[best.left].used || stamps[best.right].used) continue;
    matches.push_back(best.match);
    unlink(stamps, best.left);
    unlink(stamps, best.right);
    offer(stamps[best.left].prev, stamps[best.right].next);
  }
  std::sort(matches.begin(), matches.end(),
            [](const Match& a, const Match& b) { return a.estimate < b.estimate; });
  return matches;
}

MatchedPoses match_nearest(const Trajectory& estimate, const Trajectory& groundtruth,
                           double max_difference_s) {
  MatchedPoses pairs;
  for (const Match& m : associate(estimate, groundtruth, max_difference_s)) {
    pairs.estimate.push_back(estimate[m.estimate]);
    pairs.groundtruth.push_back(groundtruth[m.groundtruth]);
  }
  return pairs;
}

MatchedPoses match_interpolated(const Trajectory& estimate, const Trajectory& groundtruth, double max_gap_s) {
  MatchedPoses pairs;
  std::size_t next = 0;  // first ground-truth pose not before the estimate's
  for (const StampedPose& e : estimate) {
    while (next < groundtruth.size() && groundtruth[next].t < e.t) ++next;
    if (next == groundtruth.size()) break;
    const StampedPose& b = groundtruth[next];
    if (b.t == e.t) {
      pairs.estimate.push_back(e);
      pairs.groundtruth.push_back(b);
    } else if (next > 0 && seconds_between(groundtruth[next - 1].t, b.t) <= max_gap_s) {
      const StampedPose& a = groundtruth[next - 1];
      const double alpha = seconds_between(a.t, e.t) / seconds_between(a.t, b.t);
      pairs.estimate.push_back(e);
      pairs.groundtruth.push_back({e.t, interpolate(a.T, b.T, alpha)});
    }
  }
  return pairs;
}

double time_coverage(const Trajectory& estimate, Time begin, Time end) {
  if (estimate.empty() || end <= begin) return 0.0;
  std::vector<Time> intervals;
  for (std::size_t i = 1; i < estimate.size(); ++i) intervals.push_back(estimate[i].t - estimate[i - 1].t);
  Time hole = from_seconds(1.0);
  if (!intervals.empty()) hole = std::max(hole, 5 * median(std::move(intervals)));
  Time covered = 0;
  for (std::size_t i = 1; i < estimate.size(); ++i) {
    const Time from = estimate[i - 1].t;
    const Time to = estimate[i].t;
    if (to - from <= hole) covered += std::max<Time>(0, std::min(to, end) - std::max(from, begin));
  }
  return static_cast<double>(covered) / static_cast<double>(end - begin);
}

}  // namespace idol
