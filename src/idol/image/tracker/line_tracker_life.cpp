// From a track's birth to its end: is it a line, where does it end, is it one with another, has it been here
// before?
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "idol/frontend/moving_line.hpp"
#include "idol/image/tracker/line_tracker.hpp"

namespace idol {
namespace {

constexpr double kEndFade = 0.6;      // of the counts about the ends at each look
constexpr float kEndDensity = 0.3F;   // of the line's density: where it falls below, the line ends
constexpr float kGapFade = 0.85F;     // of the counts along a line at each look
constexpr float kGapEvents = 16;      // expected in two pixels, at least, before none there means a gap
constexpr float kGapDensity = 0.06F;  // of the line's, at most, in two pixels of a gap
constexpr double kLeastFilled = 0.7;  // share of the pixels along a line that have their share of its events
constexpr double kLostNear = 8;       // of its place then, at most [px]: lines get lost at sudden turns
constexpr double kLostParallel = 0.96;  // cosine
constexpr double kOverlap = 1;  // of two tracks of one line, at least: its pieces grow until they meet [px]

// A track is validated after so much motion [px] and so many events of its own.
constexpr double kValidTravel = 1.5, kValidEvents = 35;
constexpr double kLook = 1.5;                         // motion between looks at a track's statistics [px],
constexpr double kFade = 0.6;                         // which fade by this at each
constexpr double kFastest = 8000, kFastestTurn = 60;  // [px/s], of the slope [1/s]

// Noise: its share among a line's events that makes one look uncertain, standard deviations of its number
// that are sure, a line's events over it, and its number since birth that a line must outdo.
constexpr double kNoisy = 0.03, kSure = 2, kOverNoise = 1, kMuchNoise = 30;

// The shape across: share of near events among these and those beside (else texture); mean square distance
// over that of the gate, where evenly spread events have 1/3; kurtosis, where a normal distribution cut off
// at kGateSigmas has 2.4, an even one 1.8 and two edges less, asked for where the mean square distance is
// more than kFuller of the gate's.
constexpr double kMinCore = 0.7, kUniform = 0.3, kFlat = 1.8, kFuller = 0.2;
constexpr double kLeastSigma = 0.35;  // [px]
constexpr double kLeastAspect = 12;   // length over scatter of a line, at least

// Variance of a normal distribution cut off at so many standard deviations, over its own.
double cut_variance(double sigmas) {
  const double inside = std::erf(sigmas / std::numbers::sqrt2);
  const double density = std::exp(-sigmas * sigmas / 2) / std::sqrt(2 * std::numbers::pi);
  return 1 - 2 * sigmas * density / inside;
}

// How far the ends of `b` are from the line of `a`, and from where to where along it `b` reaches [px].
struct Extent {
  double worst = 0, least = 1e9, most = -1e9;
};
Extent extent_on(const LineTrack& a, const LineTrack& b) {
  Extent out;
  for (const double u : {b.lo, b.hi}) {
    const Eigen::Vector2d d = b.centre + u * b.dir - a.centre;
    out.worst = std::max(out.worst, std::abs(a.normal.dot(d)));
    out.least = std::min(out.least, a.dir.dot(d)), out.most = std::max(out.most, a.dir.dot(d));
  }
  return out;
}

// Two edges of one place and direction that fire with opposite polarities cannot be one.
bool opposite(const LineTrack& a, const LineTrack& b) {
  const double same = a.dir.dot(b.dir) > 0 ? 1 : -1;
  return same * a.contrast * b.contrast < 0 && std::abs(a.contrast) > 0.5 * a.core &&
         std::abs(b.contrast) > 0.5 * b.core;
}

// Where a gap inside the line begins and ends, by the counts along it.
std::optional<std::pair<double, double>> find_gap(const LineTrack& track) {
  const std::ptrdiff_t first =
      std::max<std::ptrdiff_t>(0, static_cast<std::ptrdiff_t>(track.lo - track.along_at));
  const std::ptrdiff_t last =
      std::min(std::ssize(track.along), static_cast<std::ptrdiff_t>(track.hi - track.along_at) + 1);
  if (last - first < 8) return std::nullopt;
  const auto begin = track.along.begin();
  const float density = std::accumulate(begin + first, begin + last, 0.0F) / static_cast<float>(last - first);
  if (2 * density < kGapEvents) return std::nullopt;
  std::ptrdiff_t from = -1;
  float least = 2 * kGapDensity * density;
  for (std::ptrdiff_t k = first + 2; k + 4 < last; ++k)
    if (const float pair = begin[k] + begin[k + 1]; pair < least) {
      least = pair;
      from = k;
    }
  if (from < 0) return std::nullopt;
  std::ptrdiff_t to = from + 2;
  while (from > first && begin[from - 1] < kEndDensity * density) --from;
  while (to + 1 < last && begin[to] < kEndDensity * density) ++to;
  return std::pair(track.along_at + static_cast<double>(from), track.along_at + static_cast<double>(to));
}

}  // namespace

// Share of the pairs of pixels along the line that have their share of its events; 1 where there are too few
// to tell. Edges fire all along; a track that lies across several has its events where it meets them.
double LineTracker::evenness(const LineTrack& track) {
  constexpr float kEnough = 4, kShare = 0.35F;  // events in a pair; of the mean
  const auto at = [&](double u) { return static_cast<std::ptrdiff_t>(u - track.along_at); };
  const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, at(track.lo) + 1),
                       last = std::min(std::ssize(track.along), at(track.hi));
  const std::ptrdiff_t pairs = (last - first) / 2;
  if (pairs < 3) return 1;
  const auto begin = track.along.begin() + first;
  const float mean = std::accumulate(begin, begin + 2 * pairs, 0.0F) / static_cast<float>(pairs);
  if (mean < kEnough) return 1;
  std::ptrdiff_t full = 0;
  for (std::ptrdiff_t k = 0; k < pairs; ++k) full += begin[2 * k] + begin[2 * k + 1] > kShare * mean ? 1 : 0;
  return static_cast<double>(full) / static_cast<double>(pairs);
}

// How far an end goes out, to where two pixels together have too few events; the counts move with it [px].
double LineTracker::move_end(EndCounts& counts, float density) {
  const int size = static_cast<int>(counts.size());
  int end = 0;
  while (end + 1 < size && counts[end] + counts[end + 1] > 2 * kEndDensity * density) ++end;
  if (end > 0 && counts[end] > kEndDensity * density) ++end;
  const int moved = end - kEndInside;
  EndCounts shifted;
  for (int k = 0; k < size; ++k) {
    const int from = k + moved;
    shifted[k] = from < 0 ? density : from < size ? counts[from] : 0;
  }
  counts = shifted;
  return moved;
}
// After each few pixels of motion: is it still a line, and where does it end?
void LineTracker::assess(LineTrack& track, Time now) {
  const double length = track.hi - track.lo, speed = std::abs(track.x[2]);
  // A line that hardly moves makes hardly any events.
  constexpr double kQuietMotion = 3, kLongestQuiet = 2;  // [px], [s]
  const double quiet = std::clamp(kQuietMotion / std::max(1e-3, speed), options_.max_quiet_s,
                                  std::max(options_.max_quiet_s, kLongestQuiet));
  if (seconds_between(track.last_event, now) > quiet) end(track, EndReason::kQuiet);
  if (speed > kFastest || std::abs(track.x[3]) > kFastestTurn) end(track, EndReason::kFast);
  // Ends: by events, so that slow motion has time.
  if (track.unlooked > std::max(16.0, 0.8 * length)) {
    const auto density = static_cast<float>(track.all / length);
    if (density > 1) {
      track.hi += move_end(track.at_hi, density);
      track.lo -= move_end(track.at_lo, density);
    }
    track.at_lo *= kEndFade, track.at_hi *= kEndFade, track.all *= kEndFade;
    track.unlooked = 0;
    split(track, now);
    if (evenness(track) < kLeastFilled) end(track, EndReason::kUneven);
    if (track.hi - track.lo < 0.7 * std::max(options_.min_length_px, kLeastAspect * track.sigma))
      end(track, EndReason::kBrief);
  }
  if (track.by_chance > kMuchNoise && track.support < track.by_chance) end(track, EndReason::kNoise);
  if (track.fresh_travel < kLook) return;
  // Another edge may pass on one side; texture is on both.
  const double ring = 2 * std::min(track.left, track.right), near = track.core + ring;
  if (track.core < kMinDensity * length * track.fresh_travel && track.fresh_travel > 3)
    end(track, EndReason::kSparse);
  // `noise` is of the gate; what is left of the core must stand out of its own share of it.
  const double by_chance = LineClaims::kCoreGate * track.noise;
  if (by_chance > 4 && track.core < kOverNoise * by_chance) end(track, EndReason::kNoise);
  const double excess = ring - (1 / kMinCore - 1) * track.core;
  double variance = (2 - LineClaims::kCoreGate) * track.noise;
  if (track.noise > kNoisy * near) variance += std::max(0.0, ring) + std::max(0.0, track.core) / 2;
  if (near > 30 && excess > kSure * std::sqrt(variance)) end(track, EndReason::kBeside);
  const double n = track.bow_n - track.noise;
  const double bow = n > 30 ? 7.5 * std::abs(track.bow) / n : 0;
  const double straight = most_bow_px(options_.max_bow_px, length, track.sigma, std::max(30.0, n));
  if (n > 60 && bow > straight) end(track, EndReason::kBent);
  if (n > 30) {
    const double width = gate(track), square = track.spread / n;
    if (square > kUniform * width * width) end(track, EndReason::kWide);
    // Only where they fill the gate more than a normal distribution does: what pixels make of a sharp edge is
    // even.
    if (n > 60 && square > kFuller * width * width && track.fourth / n < kFlat * square * square)
      end(track, EndReason::kDouble);
    const double sigma = std::sqrt(std::max(0.0, square) / cut_variance(width / track.sigma));
    track.sigma = std::clamp(track.sigma + 0.5 * (sigma - track.sigma), kLeastSigma, EdgeLimits::kMostSigma);
  }
  if (track.alive && !track.validated && track.travel > kValidTravel &&
      track.support > kValidEvents + 5 * std::sqrt(track.by_chance) + track.by_chance &&
      length >= options_.min_length_px && length > kLeastAspect * track.sigma && bow < straight) {
    promote(track, now);
  }
  for (double* sum : {&track.core, &track.left, &track.right, &track.contrast, &track.bow, &track.bow_n,
                      &track.spread, &track.fourth, &track.noise})
    *sum *= kFade;
  track.fresh_travel *= kFade;
}
void LineTracker::end(LineTrack& track, EndReason reason) {
  if (!track.alive) return;
  constexpr double kYoung = 20;  // [px]
  track.alive = false;
  track.refused = track.travel < kYoung && (reason == EndReason::kBent || reason == EndReason::kWide ||
                                            reason == EndReason::kDouble || reason == EndReason::kUneven);
  ++counts_.ended[static_cast<std::size_t>(reason)];
}
// A track gets known; where one ended of late, which would now lie here, it is that one.
void LineTracker::promote(LineTrack& track, Time now) {
  track.validated = true;
  ++counts_.validated;
  known_.at(track.id).validated = true;
  const double length = track.hi - track.lo;
  const LineId was = track.id;
  newly_validated_.emplace_back(was, was);
  auto found = lost_.end();
  double nearest = kLostNear;
  for (auto it = lost_.begin(); it != lost_.end(); ++it) {
    LineTrack& lost = *it;
    if (std::abs(lost.dir.dot(track.dir)) < kLostParallel) continue;
    advance(lost, now);
    const auto [worst, least, most] = extent_on(lost, track);
    const double overlap = std::min(most, lost.hi) - std::max(least, lost.lo);
    if (worst > nearest || overlap < 0.5 * std::min(length, lost.hi - lost.lo)) continue;
    if (opposite(track, lost)) continue;
    nearest = worst;
    found = it;
  }
  if (found == lost_.end()) return;
  known_.at(track.id).merged_into = found->id;
  track.id = found->id;
  track.born = found->born;
  newly_validated_.back().second = track.id;
  lost_.erase(found);
}
// At a gap inside, the longer piece goes on as this track, the other as a new one.
void LineTracker::split(LineTrack& track, Time now) {
  const auto gap = find_gap(track);
  for (float& count : track.along) count *= kGapFade;
  if (!gap) return;
  const auto [end, begin] = *gap;
  const double length = track.hi - track.lo;
  LineTrack other = track;
  const bool low_is_longer = end - track.lo > track.hi - begin;
  LineTrack& low = low_is_longer ? track : other;
  LineTrack& high = low_is_longer ? other : track;
  low.hi = end, high.lo = begin;
  const auto share = [&](LineTrack& piece, EndCounts& cut) {
    const double part = std::max(0.0, piece.hi - piece.lo) / length;
    cut.setZero();
    cut.head<kEndInside>() = static_cast<float>(piece.all / length);
    for (double* sum : {&piece.core, &piece.left, &piece.right, &piece.contrast, &piece.bow, &piece.bow_n,
                        &piece.spread, &piece.fourth, &piece.noise, &piece.all})
      *sum *= part;
  };
  share(low, low.at_hi), share(high, high.at_lo);
  if (other.hi - other.lo < options_.min_length_px ||
      std::ssize(tracks_) + std::ssize(split_off_) >= options_.max_lines)
    return;
  other.id = next_id_++;
  other.waiting = {};
  other.born = now;
  known_[other.id] = {kNoLine, other.validated, other.normal, other.last_event};
  split_off_.push_back(std::move(other));
}

void LineTracker::seed(const LineSeed& seed) {
  const Time now = seed.time;
  if (std::ssize(tracks_) >= options_.max_lines) return;
  LineTrack track;
  track.centre = seed.centre;
  track.normal = seed.normal;
  track.dir = {seed.normal.y(), -seed.normal.x()};
  track.lo = -seed.length / 2, track.hi = seed.length / 2;
  track.x << 0, 0, seed.speed, 0;
  const double slope = 1.0 / seed.length, rate = 0.2 * std::abs(seed.speed) + 20;
  track.P =
      Eigen::Vector4d(0.25, slope * slope, rate * rate + seed.speed_sigma * seed.speed_sigma, 4).asDiagonal();
  track.sigma = std::clamp(seed.sigma, kLeastSigma, EdgeLimits::kMostSigma);
  track.time = track.born = track.last_event = now;
  // A line that is already followed here must not be followed twice.
  for (LineTrack& other : tracks_) {
    if (std::abs(other.dir.dot(track.dir)) < 0.985) continue;
    const double dt = seconds_between(other.time, now);
    double worst = 0;
    double least = 1e9, most = -1e9;
    for (const double u : {track.lo, track.hi}) {
      const Eigen::Vector2d d = track.centre + u * track.dir - other.centre;
      const double along = other.dir.dot(d);
      worst = std::max(worst, std::abs(other.normal.dot(d) - other.x[0] - other.x[1] * along -
                                       (other.x[2] + other.x[3] * along) * dt));
      least = std::min(least, along), most = std::max(most, along);
    }
    if (expected_polarity(other) * (seed.polarity ? 1 : -1) < 0) continue;  // the other edge of a thin bar
    if (worst > std::max(1.5, 1.3 * gate(other)) || least > other.hi - kOverlap || most < other.lo + kOverlap)
      continue;
    other.lo = std::min(other.lo, least), other.hi = std::max(other.hi, most);
    return;
  }
  track.id = next_id_++;
  ++counts_.born;
  known_[track.id] = {kNoLine, false, track.normal, now, track.sigma, now};
  tracks_.push_back(track);
}
// Lines without events move as the others around them do.
void LineTracker::propagate_lost(Time now) {
  for (LineTrack& lost : lost_) {
    advance(lost, now);
    const double half = std::max(1.0, 0.5 * (lost.hi - lost.lo));
    const Eigen::Vector2d a = flow(lost.centre - half * lost.dir), b = flow(lost.centre + half * lost.dir);
    lost.x[2] = lost.normal.dot(a + b) / 2;
    lost.x[3] = lost.normal.dot(b - a) / (2 * half);
  }
}
// Two tracks on one line with one motion: the older goes on with both extents.
void LineTracker::merge_lines(Time now) {
  std::vector<Eigen::Vector2d> dirs;  // side by side: most pairs are not parallel
  for (LineTrack& track : tracks_) {
    predict(track, now);
    dirs.push_back(track.dir);
  }
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    LineTrack& a = tracks_[i];
    if (!a.alive) continue;
    for (std::size_t j = i + 1; j < tracks_.size(); ++j) {
      if (std::abs(dirs[i].dot(dirs[j])) < 0.99) continue;
      LineTrack& b = tracks_[j];
      if (!b.alive) continue;
      const double same = a.dir.dot(b.dir) > 0 ? 1 : -1;
      const auto [worst, least, most] = extent_on(a, b);
      // By the direction of the longer one, which is known better.
      const double apart = b.hi - b.lo > a.hi - a.lo ? extent_on(b, a).worst : worst;
      if (apart > std::max(1.2, 0.8 * std::min(a.sigma, b.sigma) + 0.8) || least > a.hi - kOverlap ||
          most < a.lo + kOverlap)
        continue;
      const double at = a.dir.dot(b.centre - a.centre);
      if (std::abs(a.x[2] + a.x[3] * at - same * b.x[2]) > 20 + 0.25 * std::abs(b.x[2])) continue;
      if (opposite(a, b)) continue;  // the two edges of a thin bar
      a.lo = std::min(a.lo, least), a.hi = std::max(a.hi, most);
      b.alive = false;
      const bool promoted = a.validated != b.validated;
      if (b.validated && !a.validated) {  // under the id that is known
        a.validated = true;
        std::swap(a.id, b.id);
      }
      if (promoted) newly_validated_.emplace_back(b.id, a.id);
      known_.at(b.id).merged_into = a.id;
    }
  }
  std::erase_if(tracks_, [](const LineTrack& t) { return !t.alive; });
}

}  // namespace idol
