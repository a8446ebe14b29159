#include "idol/image/tracker/line_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace idol {
namespace {

constexpr double kStopTime = 0.03;     // in which a line without events comes to rest [s]
constexpr double kLostMemory = 0.6;    // how long after its last event a line may come back [s]
constexpr double kBatchShare = 0.4;    // of their scatter: what the events of a batch err together
constexpr double kEnough = 16;         // events that correct a line, beside those of noise
constexpr double kLongestWait = 0.02;  // mean age at which fewer do [s]
constexpr double kNoiseLumps = 4;  // noise is expected in so many times its mean number: it comes in lumps
constexpr double kMostByChance = 0.35;  // neighbours that noise may give to an event
constexpr double kNoiseMemory = 0.2;    // [s]
constexpr double kNoisePass = 0.3;      // share of noise that has support by chance, at most
constexpr int kSupport = 4;             // events near in space and time that one needs, itself included

// Room for the counts along the line and a little beyond its ends.
void cover(LineTrack& track) {
  constexpr double kMargin = 2, kSpare = 16;
  const double from = track.lo - kMargin, to = track.hi + kMargin;
  if (from >= track.along_at && to <= track.along_at + static_cast<double>(track.along.size())) return;
  const auto before = static_cast<std::ptrdiff_t>(std::ceil(track.along_at - from + kSpare));
  std::vector<float> wider(static_cast<std::size_t>(to - from + 2 * kSpare) + 1);
  for (std::ptrdiff_t k = 0; k < std::ssize(track.along); ++k)
    if (k + before >= 0 && k + before < std::ssize(wider)) wider[k + before] = track.along[k];
  track.along = std::move(wider);
  track.along_at -= static_cast<double>(before);
}

}  // namespace

LineTracker::LineTracker(const TrackOptions& options, const UndistortMap& undistort)
    : options_(options),
      undistort_(&undistort),
      claims_(undistort),
      detector_(undistort),
      isolated_(undistort.pixels()) {
  for (auto& last : last_) last.resize(undistort.pixels());
  recent_cols_ = undistort.width() / 4 + 2;
  const auto cells = static_cast<std::size_t>(recent_cols_ * (undistort.height() / 4 + 2));
  for (auto& recent : recent_) recent.resize(cells);
  for (auto& turn : turn_) turn.resize(cells);
}

std::size_t LineTracker::batch_length(std::span<const Event> events, Time origin) const {
  const Time step = from_seconds(options_.batch_s);
  const Time end = origin + ((events.front().t - origin) / step + 1) * step;
  const auto most = events.first(std::min(events.size(), static_cast<std::size_t>(options_.batch_events)));
  const auto after =
      std::partition_point(most.begin(), most.end(), [&](const Event& e) { return e.t < end; });
  return static_cast<std::size_t>(after - most.begin());
}

LineId LineTracker::final_id(LineId id) const {
  for (LineId next = known_.at(id).merged_into; next != kNoLine; next = known_.at(id).merged_into) id = next;
  return id;
}

void LineTracker::forget_before(Time t) {
  for (const auto& track : tracks_) known_.at(track.id).last_event = t;
  for (const auto& track : lost_) known_.at(track.id).last_event = t;
  for (const auto& [id, known] : known_)
    if (known.last_event >= t)
      for (LineId next = known.merged_into; next != kNoLine; next = known_.at(next).merged_into)
        known_.at(next).last_event = std::max(known_.at(next).last_event, t);
  std::erase_if(known_, [&](const auto& entry) { return entry.second.last_event < t; });
}

// From how many events without neighbours on, fading, a pixel is hot: one alone has some where noise is much.
std::uint8_t LineTracker::hot_from() const {
  constexpr double kHot = 24, kTimesNoise = 3;
  return static_cast<std::uint8_t>(
      std::min(250.0, kHot + (noise_known_s_ > kNoiseMemory ? kTimesNoise * background_ : 0)));
}

// Events this near are the line's own [px]: by its width, and by how well its place is known.
double LineTracker::gate(const LineTrack& track) {
  return std::clamp(kGateSigmas * std::sqrt(track.sigma * track.sigma + std::min(1.0, track.P(0, 0))),
                    EdgeLimits::kLeastGate, EdgeLimits::kMostGate);
}

// 1, -1, or 0 where it is not known. Polarity times direction of motion is a property of an edge.
float LineTracker::expected_polarity(const LineTrack& track) {
  if (std::abs(track.x[2]) < std::max(5.0, 2 * std::sqrt(track.P(2, 2))) || track.core < 20 ||
      std::abs(track.contrast) < 0.6 * (track.core + 1))
    return 0;
  return (track.contrast > 0) == (track.x[2] > 0) ? 1.0F : -1.0F;
}

// As it is predicted, in single precision.
ClaimingLine LineTracker::claiming(LineTrack& track) {
  ClaimingLine line;
  line.id = track.id;
  line.cx = static_cast<float>(track.centre.x()), line.cy = static_cast<float>(track.centre.y());
  line.dx = static_cast<float>(track.dir.x()), line.dy = static_cast<float>(track.dir.y());
  line.half = static_cast<float>(track.hi);
  line.rate = static_cast<float>(track.x[2]), line.turn = static_cast<float>(track.x[3]);
  line.gate = static_cast<float>(gate(track));
  cover(track);
  line.along = track.along.data(), line.along_at = static_cast<float>(track.along_at);
  line.expected = expected_polarity(track);
  return line;
}

void LineTracker::process(std::span<const Event> events, LineId* labels) {
  if (events.empty()) return;
  const Time begin = events.front().t, end = events.back().t;
  const Time middle = begin + (end - begin) / 2;
  lines_.clear();
  for (LineTrack& track : tracks_) {
    advance(track, middle);
    lines_.push_back(claiming(track));
  }
  hot_ += static_cast<std::int64_t>(claims_.claim(events, middle, lines_, isolated_, hot_from(), labels));

  // A batch stands for the time since the one before; after a long pause, for as long as it was thought to
  // be.
  const double duration = std::clamp(seconds_between(last_batch_, end), 0.0, 5 * options_.batch_s);
  last_batch_ = end;
  for (std::size_t k = 0; k < tracks_.size(); ++k) {
    correct(tracks_[k], lines_[k], background_ * duration, duration);
    assess(tracks_[k], end);
    Known& known = known_.at(tracks_[k].id);
    known.normal = tracks_[k].normal;
    known.last_event = tracks_[k].last_event;
    known.sigma = tracks_[k].sigma;
    known.polarity = lines_[k].expected;
  }
  for (const LineTrack& track : tracks_)
    if (!track.alive && track.refused) detector_.discourage(track.centre);
  for (LineTrack& track : tracks_)
    if (!track.alive && track.validated) lost_.push_back(std::move(track));
  std::erase_if(lost_, [&](const LineTrack& t) { return seconds_between(t.last_event, end) > kLostMemory; });
  std::erase_if(tracks_, [](const LineTrack& t) { return !t.alive; });
  std::move(split_off_.begin(), split_off_.end(), std::back_inserter(tracks_));
  split_off_.clear();

  search(events, duration);
  if (end >= next_fade_) {
    for (std::uint8_t& count : isolated_)
      count = static_cast<std::uint8_t>(count - count / 4 - (count > 0 ? 1 : 0));
    next_fade_ = end + from_seconds(0.25);
  }
  if (end >= next_merge_) {
    merge_lines(end);
    adapt_scale();
    fit_flow();
    propagate_lost(end);
    next_merge_ = end + from_seconds(0.01);
  }
}

// Have enough events of its polarity come of late about this one? Counts it, too.
bool LineTracker::support_of(const Event& e, std::uint32_t us, std::uint32_t within) {
  auto& recent = recent_[e.polarity ? 1 : 0];
  // The four cells nearest to the event, with a border of one around the image.
  const int col = (e.x + 2) / 4, row = (e.y + 2) / 4;
  const auto at = static_cast<std::size_t>(row * recent_cols_ + col);
  const auto own = static_cast<std::size_t>((e.y / 4 + 1) * recent_cols_ + e.x / 4 + 1);
  std::uint8_t& turn = turn_[e.polarity ? 1 : 0][own];
  recent[own][turn++ % 4U] = us == 0 ? 1 : us;
  int count = 0;
  for (const std::size_t cell : {at, at + 1, at + static_cast<std::size_t>(recent_cols_),
                                 at + static_cast<std::size_t>(recent_cols_) + 1})
    for (const std::uint32_t then : recent[cell]) count += then != 0 && us - then < within ? 1 : 0;
  return count >= kSupport;
}

// Events without a line: the supported ones go to the detector.
void LineTracker::search(std::span<const Event> events, double duration) {
  const int w = undistort_->width();
  const std::span<const std::uint32_t> rest = claims_.rest();
  const auto now_us = [](Time t) { return static_cast<std::uint32_t>(t / 1000); };
  const double by_chance = kMostByChance / std::max(1e-3, 4 * background_);
  const auto support = static_cast<std::uint32_t>(std::clamp(by_chance, 0.001, 0.05) * 1e6);
  const int h = undistort_->height();
  // Of noise alone, so many events come in this time in the area that is asked for support.
  constexpr double kNoiseShare = 0.3, kArea = 32;  // [px^2], of one polarity
  const auto within = static_cast<std::uint32_t>(
      1e6 * std::clamp(kNoiseShare * kSupport / (kArea * std::max(1e-3, background_)), 5e-4, 0.15));
  int alone = 0;
  detector_.begin_batch(
      events.front().t,
      options_.detect_rate * std::max(1e-3, seconds_between(events.front().t, events.back().t)),
      options_.min_length_px, noise_known_s_ > kNoiseMemory / 2 ? kNoisePass * background_ : 0);
  for (std::size_t k = 0; k < rest.size(); ++k) {
    const Event& e = events[rest[k]];
    const std::size_t pixel = static_cast<std::size_t>(e.y) * w + e.x;
    const std::uint32_t us = now_us(e.t);
    auto& last = last_[e.polarity ? 1 : 0];
    last[pixel] = us;
    const bool supported = support_of(e, us, within);
    if (e.x == 0 || e.y == 0 || e.x == w - 1 || e.y == h - 1) continue;
    int neighbours = 0;
    for (const int d : {-w - 1, -w, -w + 1, -1, 1, w - 1, w, w + 1})
      neighbours +=
          us - last[pixel + static_cast<std::size_t>(static_cast<std::ptrdiff_t>(d))] < support ? 1 : 0;
    if (neighbours == 0) {
      ++alone;
      ++unsupported_;
      if (isolated_[pixel] < 255) ++isolated_[pixel];
      continue;
    }
    if (!supported && noise_known_s_ > kNoiseMemory / 2) {
      ++unsupported_;
      continue;
    }
    detector_.add(e);
  }
  for (const LineSeed& found : detector_.end_batch()) seed(found);
  if (duration > 0) {
    // Noise has no neighbours, but by chance.
    const double chance = std::exp(-4 * background_ * 1e-6 * support);
    // Where lines claim the events there is no telling.
    double claimed = 0;  // [px^2]
    for (const ClaimingLine& line : lines_) claimed += 4.0 * line.gate * line.half;
    const double all = 1.0 * w * h, area = std::max(0.2 * all, all - claimed);
    const double now = alone / (chance * duration * area);
    noise_known_s_ += duration;
    background_ += (now - background_) * std::min(1.0, duration / std::min(kNoiseMemory, noise_known_s_));
  }
}

// Two scalar measurements of one or more batches: mean distance of the near events, and tilt along the line.
// `noise`: expected in the batch by chance [1/px], to be taken off all counts.
void LineTracker::correct(LineTrack& track, const ClaimingLine& f, double noise, double duration) {
  if (f.expected != 0) noise /= 2;  // of one polarity
  const double gate = LineTracker::gate(track), strip = noise * (track.hi - track.lo) * 2 * gate;
  const double beside = (1 - 0.5 * LineClaims::kCoreGate) * strip;
  track.core += f.core - LineClaims::kCoreGate * strip;
  track.left += f.left - beside, track.right += f.right - beside;
  track.noise += strip;
  const auto end_noise = static_cast<float>(noise * 2 * gate);
  track.at_lo += f.at_lo - end_noise, track.at_hi += f.at_hi - end_noise;
  track.all += f.n - strip, track.unlooked += f.n - strip;
  if (std::abs(f.rate) > 5) track.contrast += f.rate > 0 ? f.contrast : -f.contrast;
  if (f.last > track.last_event) track.last_event = f.last;
  // An edge without events of its own does not move.
  const double expected = kMinDensity * (track.hi - track.lo) * std::abs(track.x[2]) * duration;
  if (expected > 1 && f.n < 2 + strip) track.x.tail<2>() *= std::exp(-duration / kStopTime);
  if (f.n == 0) return;
  track.support += f.n - strip;
  track.by_chance += strip;
  auto& waiting = track.waiting;
  waiting.n += f.n, waiting.u += f.u, waiting.uu += f.uu, waiting.r += f.r, waiting.ur += f.ur,
      waiting.t += f.t;
  waiting.noise += strip;
  track.bow += f.bow, track.bow_n += f.n, track.spread += f.rr - strip * gate * gate / 3;
  track.fourth += f.rrrr - strip * gate * gate * gate * gate / 5;
  const double stray = kNoiseLumps * waiting.noise;
  if (waiting.n < kEnough + stray && waiting.t > -kLongestWait * waiting.n) return;
  const LineTrack::Waiting sums = std::exchange(waiting, {});
  const double n = sums.n, u = sums.u / n, r = sums.r / n, t = sums.t / n;
  const auto update = [&](const Eigen::Vector4d& h, double z, double variance) {
    const Eigen::Vector4d ph = track.P * h;
    const double s = h.dot(ph) + variance;
    const Eigen::Vector4d gain = ph / s;
    track.x += gain * (z - h.dot(track.x));
    track.P -= gain * ph.transpose();
  };
  // A share of noise, evenly over the gate, draws the mean towards the prediction and scatters it.
  const double noisy = std::min(0.95, stray / n), own = 1 - noisy;
  const double scatter = (own * track.sigma * track.sigma + noisy * gate * gate / 3) / (own * own);
  const double together = kBatchShare * track.sigma;
  // Residuals are against the predicted rates: these come back as what the measurement says of the whole
  // state.
  const double rate = track.x[2], turn = track.x[3];
  update({1, u, t, u * t}, r + (rate + turn * u) * t, together * together + scatter / n);
  const double uu = sums.uu - n * u * u;
  const double length = track.hi - track.lo;
  if (n >= 4 && uu > 0.02 * n * length * length) {
    const double tilt = (sums.ur - n * u * r) / uu;
    update({0, 1, 0, t}, tilt + turn * t, scatter / uu + 12 * together * together / (length * length));
  }
}

}  // namespace idol
