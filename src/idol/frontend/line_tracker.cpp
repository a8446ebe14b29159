#include "idol/frontend/line_tracker.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace idol {
namespace {

constexpr int kCell = 2;                           // cells of the image that name the lines in them [px]
constexpr float kEndMargin = LineTrack::kOutside;  // events this far beyond an end are looked at [px]
constexpr double kStopTime = 0.03;                 // in which a line without events comes to rest [s]
constexpr double kLostMemory = 0.6;                // how long after its last event a line may come back [s]
constexpr double kEventSigma = 0.55;               // scatter of an edge's events across it [px]
constexpr double kBatchSigma = 0.2;                // what the events of a batch err together [px]
constexpr double kEnough = 16;                     // events that correct a line, beside those of noise
constexpr double kLongestWait = 0.02;              // mean age at which fewer do [s]
constexpr double kNoiseLumps = 4;  // noise is expected in so many times its mean number: it comes in lumps
constexpr double kMostByChance = 0.35;  // neighbours that noise may give to an event
constexpr double kNoiseMemory = 0.2;    // [s]
constexpr std::size_t kAhead = 8;       // events whose memory is fetched before their turn
constexpr int kHot = 24;                // unsupported events in half a second or so

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

struct LineTracker::Fast {
  float cx, cy, dx, dy, nx, ny, lo, hi, rate, turn, mid, inv_half;
  // Sums over the batch: near events for the state, the rest for the statistics.
  int n = 0;
  float u = 0, uu = 0, r = 0, ur = 0, t = 0, rr = 0, bow = 0;
  int core = 0, ring = 0, pol = 0, claimed = 0;
  LineTrack::EndCounts at_lo = LineTrack::EndCounts::Zero(), at_hi = LineTrack::EndCounts::Zero();
  float* along = nullptr;  // of the track, from along_at on
  float along_at = 0;
  Time last = 0;
  float wanted = 0;  // polarity expected, 0 = any
};

// A line that an event is near to: along it, across it [px].
struct LineTracker::Candidate {
  int line;
  float u, r;
};

LineTracker::LineTracker(const TrackOptions& options, const UndistortMap& undistort)
    : options_(options), undistort_(&undistort), detector_(undistort) {
  const int w = undistort.width(), h = undistort.height();
  const std::size_t pixels = undistort.pixels();
  // Strong distortion can throw the corners far out: cells beyond twice the sensor are of no use.
  Eigen::Vector2f low(1e9F, 1e9F), high(-1e9F, -1e9F);
  const Eigen::Vector2f size(static_cast<float>(w), static_cast<float>(h));
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      low = low.cwiseMin(undistort(x, y));
      high = high.cwiseMax(undistort(x, y));
    }
  low = low.cwiseMax(-size);
  high = high.cwiseMin(2 * size);
  low_ = low;
  cols_ = static_cast<int>((high.x() - low.x()) / kCell) + 1;
  rows_ = static_cast<int>((high.y() - low.y()) / kCell) + 1;
  claims_.resize(static_cast<std::size_t>(cols_) * static_cast<std::size_t>(rows_));
  pixels_.resize(pixels);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Eigen::Vector2f p = undistort(x, y), inside = p.cwiseMax(low).cwiseMin(high);
      const Eigen::Vector2i cell = ((inside - low_) / kCell).cast<int>();
      pixels_[static_cast<std::size_t>(y) * w + x] = {
          p.x(), p.y(), static_cast<std::uint32_t>(cell.y() * cols_ + cell.x()), 0};
    }
  for (auto& last : last_) last.resize(pixels);
}

std::size_t LineTracker::batch_length(std::span<const Event> events, Time origin) const {
  const Time step = from_seconds(options_.batch_s);
  const Time end = origin + ((events.front().t - origin) / step + 1) * step;
  const auto most = std::min(events.size(), static_cast<std::size_t>(options_.batch_events));
  std::size_t n = 0;
  while (n < most && events[n].t < end) ++n;
  return n;
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

// One more event, so many px beyond an end.
void LineTracker::count_end(LineTrack::EndCounts& counts, float beyond) {
  const int at = static_cast<int>(beyond + LineTrack::kInside);
  if (beyond > -LineTrack::kInside && at < counts.size()) ++counts[at];
}

// Names the line in all cells that come within `band` of it.
void LineTracker::draw(std::uint16_t index, const Fast& line, float band) {
  const bool flat = std::abs(line.dx) > std::abs(line.dy);
  // In cells: walk along the longer axis; at each step those across.
  const float along = flat ? line.dx : line.dy, slope = (flat ? line.dy : line.dx) / along;
  const Eigen::Vector2f centre = (Eigen::Vector2f(line.cx, line.cy) - low_) / kCell;
  const float p0 = flat ? centre.x() : centre.y(), q0 = flat ? centre.y() : centre.x();
  const float from = p0 + (line.lo - kEndMargin) * along / kCell,
              to = p0 + (line.hi + kEndMargin) * along / kCell;
  const int n = flat ? cols_ : rows_, across = flat ? rows_ : cols_;
  const int step = flat ? cols_ : 1, stride = flat ? 1 : cols_;
  const float reach = band / kCell * std::sqrt(1 + slope * slope) + 0.5F * std::abs(slope);
  const int first = std::max(0, static_cast<int>(std::floor(std::min(from, to))));
  const int last = std::min(n - 1, static_cast<int>(std::floor(std::max(from, to))));
  for (int i = first; i <= last; ++i) {
    const float middle = q0 + (static_cast<float>(i) + 0.5F - p0) * slope;
    const int low = std::max(0, static_cast<int>(std::floor(middle - reach)));
    const int high = std::min(across - 1, static_cast<int>(std::floor(middle + reach)));
    for (int j = low; j <= high; ++j) {
      const auto cell = static_cast<std::uint32_t>(i * stride + j * step);
      auto& named = claims_[cell].line;
      if (named[0] == 0) drawn_.push_back(cell);
      for (auto& slot : named)
        if (slot == 0) {
          slot = index;
          break;
        }
    }
  }
}

void LineTracker::process(std::span<const Event> events, LineId* labels) {
  if (events.empty()) return;
  const Time begin = events.front().t, end = events.back().t;
  const Time middle = begin + (end - begin) / 2;
  const auto half_span = static_cast<float>(seconds_between(begin, end) / 2);
  const auto gate = static_cast<float>(options_.gate_px);
  const float outer = 2 * gate;

  std::vector<Fast> fast(tracks_.size());
  for (std::size_t k = 0; k < tracks_.size(); ++k) {
    LineTrack& track = tracks_[k];
    advance(track, middle);
    Fast& f = fast[k];
    f.cx = static_cast<float>(track.centre.x()), f.cy = static_cast<float>(track.centre.y());
    f.dx = static_cast<float>(track.dir.x()), f.dy = static_cast<float>(track.dir.y());
    f.nx = -f.dy, f.ny = f.dx;
    f.lo = static_cast<float>(track.lo), f.hi = static_cast<float>(track.hi);
    f.rate = static_cast<float>(track.x[2]), f.turn = static_cast<float>(track.x[3]);
    cover(track);
    f.along = track.along.data(), f.along_at = static_cast<float>(track.along_at);
    f.mid = 0.5F * (f.lo + f.hi);
    f.inv_half = 2.0F / std::max(1.0F, f.hi - f.lo);
    if (std::abs(f.rate) > 40 && std::abs(track.contrast) > 0.6 * (track.core + 1) && track.core > 20)
      f.wanted = (track.contrast > 0) == (f.rate > 0) ? 1.0F : -1.0F;
    const float most = std::abs(f.rate) + std::abs(f.turn) * (f.hi - f.lo) / 2;
    draw(static_cast<std::uint16_t>(k + 1), f, outer + std::min(4.0F, most * half_span));
  }

  const int w = undistort_->width();
  std::vector<std::uint32_t> rest;
  rest.reserve(events.size());
  for (std::uint32_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const Event& soon = events[std::min<std::size_t>(i + kAhead, events.size() - 1)];
    __builtin_prefetch(&pixels_[static_cast<std::size_t>(soon.y) * w + soon.x]);
    labels[i] = kNoLine;
    const std::size_t pixel = static_cast<std::size_t>(e.y) * w + e.x;
    const Pixel& px = pixels_[pixel];
    if (px.lonely >= kHot) {
      ++hot_;
      continue;
    }
    const Claim& claim = claims_[px.cell];
    if (claim.line[0] == 0) {
      rest.push_back(i);
      continue;
    }
    const auto dt = static_cast<float>(seconds_between(middle, e.t));
    // Lines that reach here go before those that might only grow to here.
    std::array<Candidate, 3> near;
    int count = 0, chosen = -1;
    float best = outer, best_u = 0, second = 1e9F;
    bool best_on = false;
    for (const std::uint16_t named : claim.line) {
      if (named == 0) break;
      const Fast& f = fast[static_cast<std::size_t>(named - 1)];
      const float x = px.x - f.cx, y = px.y - f.cy;
      const float u = f.dx * x + f.dy * y;
      if (u < f.lo - kEndMargin || u > f.hi + kEndMargin) continue;
      const float r = f.nx * x + f.ny * y - (f.rate + f.turn * u) * dt;
      if (std::abs(r) >= outer) continue;
      const bool on = u > f.lo - 1 && u < f.hi + 1;
      near[static_cast<std::size_t>(count++)] = {named - 1, u, r};
      if (on > best_on || (on == best_on && std::abs(r) < std::abs(best))) {
        if (best_on) second = best;
        best = r, best_u = u, best_on = on, chosen = named - 1;
      } else if (on) {
        second = r;
      }
    }
    if (chosen < 0) {
      rest.push_back(i);
      continue;
    }
    Fast& f = fast[static_cast<std::size_t>(chosen)];
    const float off = std::abs(best);
    if (off < gate && best_on) {
      labels[i] = tracks_[static_cast<std::size_t>(chosen)].id;
      f.last = e.t;
    } else {
      rest.push_back(i);
    }
    if (best_on && off < gate) f.pol += e.polarity ? 1 : -1;
    if (f.wanted != 0 && f.wanted != (e.polarity ? 1.0F : -1.0F)) continue;
    if (best_on) ++(off < kCoreGate * gate ? f.core : f.ring);
    if (best_on && off < gate) ++f.along[static_cast<int>(best_u - f.along_at)];
    if (off >= gate || (std::abs(second) < 1.5F * off + 0.5F)) continue;
    if (best_on) ++f.claimed;
    for (int k = 0; k < count; ++k) {
      // A piece of the same line grows by the events of its neighbour, too.
      const Candidate& c = near[static_cast<std::size_t>(k)];
      Fast& piece = fast[static_cast<std::size_t>(c.line)];
      if (std::abs(c.r) >= gate || std::abs(piece.dx * f.dx + piece.dy * f.dy) < kParallel) continue;
      count_end(piece.at_lo, piece.lo - c.u);
      count_end(piece.at_hi, c.u - piece.hi);
    }
    if (!best_on) continue;
    ++f.n;
    f.u += best_u, f.uu += best_u * best_u, f.r += best, f.ur += best_u * best, f.t += dt,
        f.rr += best * best;
    const float v = (best_u - f.mid) * f.inv_half;
    f.bow += best * (1.5F * v * v - 0.5F);
  }
  for (const std::uint32_t cell : drawn_) claims_[cell] = {};
  drawn_.clear();

  // A batch stands for the time since the one before; after a long pause, for as long as it was thought to
  // be.
  const double duration = std::clamp(seconds_between(last_batch_, end), 0.0, 5 * options_.batch_s);
  last_batch_ = end;
  for (std::size_t k = 0; k < tracks_.size(); ++k) {
    correct(tracks_[k], fast[k], background_ * duration, duration);
    judge(tracks_[k], end);
    Known& known = known_.at(tracks_[k].id);
    known.normal = tracks_[k].normal;
    known.last_event = tracks_[k].last_event;
  }
  for (LineTrack& track : tracks_)
    if (!track.alive && track.confirmed) lost_.push_back(std::move(track));
  std::erase_if(lost_, [&](const LineTrack& t) { return seconds_between(t.last_event, end) > kLostMemory; });
  std::erase_if(tracks_, [](const LineTrack& t) { return !t.alive; });
  std::move(parted_.begin(), parted_.end(), std::back_inserter(tracks_));
  parted_.clear();

  // The rest: supported events go to the detector.
  const auto now_us = [](Time t) { return static_cast<std::uint32_t>(t / 1000); };
  const double by_chance = kMostByChance / std::max(1e-3, 4 * background_);
  const auto support = static_cast<std::uint32_t>(std::clamp(std::min(4 * c_, by_chance), 0.005, 0.05) * 1e6);
  const int h = undistort_->height();
  int alone = 0;
  detector_.begin_batch(options_.detect_rate * std::max(1e-3, seconds_between(begin, end)), c_,
                        options_.min_length_px);
  for (std::size_t k = 0; k < rest.size(); ++k) {
    detector_.prefetch(events[rest[std::min(k + kAhead, rest.size() - 1)]]);
    const Event& e = events[rest[k]];
    const std::size_t pixel = static_cast<std::size_t>(e.y) * w + e.x;
    const std::uint32_t us = now_us(e.t);
    auto& last = last_[e.polarity ? 1 : 0];
    last[pixel] = us;
    if (e.x == 0 || e.y == 0 || e.x == w - 1 || e.y == h - 1) continue;
    int neighbours = 0;
    for (const int d : {-w - 1, -w, -w + 1, -1, 1, w - 1, w, w + 1})
      neighbours +=
          us - last[pixel + static_cast<std::size_t>(static_cast<std::ptrdiff_t>(d))] < support ? 1 : 0;
    if (neighbours == 0) {
      ++alone;
      ++unsupported_;
      if (pixels_[pixel].lonely < 255) ++pixels_[pixel].lonely;
      continue;
    }
    if (neighbours < 2) {
      ++unsupported_;
      continue;
    }
    detector_.add(e);
  }
  for (const LineSeed& found : detector_.end_batch()) seed(found);
  if (duration > 0) {
    // Noise has no neighbours, but by chance.
    const double chance = std::exp(-4 * background_ * 1e-6 * support);
    const double now = alone / (chance * duration * w * h);
    background_ += (now - background_) * std::min(1.0, duration / kNoiseMemory);
  }
  if (end >= next_fade_) {
    for (auto& px : pixels_) px.lonely -= px.lonely / 4 + (px.lonely > 0 ? 1 : 0);
    next_fade_ = end + from_seconds(0.25);
  }
  if (end >= next_merge_) {
    merge_lines(end);
    adapt_scale();
    fit_flow();
    carry_lost(end);
    next_merge_ = end + from_seconds(0.01);
  }
}

// Two scalar measurements of one or more batches: mean distance of the near events, and tilt along the line.
// `noise`: expected in the batch by chance [1/px], to be taken off all counts.
void LineTracker::correct(LineTrack& track, const Fast& f, double noise, double duration) {
  if (f.wanted != 0) noise /= 2;  // of one polarity
  const double gate = options_.gate_px, strip = noise * (track.hi - track.lo) * 2 * gate;
  track.core += f.core - kCoreGate * strip, track.ring += f.ring - (2 - kCoreGate) * strip;
  track.noise += strip;
  const auto end_noise = static_cast<float>(noise * 2 * gate);
  track.at_lo += f.at_lo - end_noise, track.at_hi += f.at_hi - end_noise;
  track.all += f.claimed - strip, track.unlooked += f.claimed - strip;
  if (std::abs(f.rate) > 25) track.contrast += f.rate > 0 ? f.pol : -f.pol;
  if (f.last > track.last_event) track.last_event = f.last;
  if (f.n < 2) {  // an edge without events does not move
    const double expected = kMinDensity * (track.hi - track.lo) * std::abs(track.x[2]) * duration;
    if (expected > 1) track.x.tail<2>() *= std::exp(-duration / kStopTime);
    if (f.n == 0) return;
  }
  auto& waiting = track.waiting;
  waiting.n += f.n, waiting.u += f.u, waiting.uu += f.uu, waiting.r += f.r, waiting.ur += f.ur,
      waiting.t += f.t;
  waiting.noise += strip;
  track.bow += f.bow, track.bow_n += f.n, track.spread += f.rr - strip * gate * gate / 3;
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
  const double scatter = (own * kEventSigma * kEventSigma + noisy * gate * gate / 3) / (own * own);
  // Residuals are against the predicted rates: these come back as what the measurement says of the whole
  // state.
  const double rate = track.x[2], turn = track.x[3];
  update({1, u, t, u * t}, r + (rate + turn * u) * t, kBatchSigma * kBatchSigma + scatter / n);
  const double uu = sums.uu - n * u * u;
  const double length = track.hi - track.lo;
  if (n >= 4 && uu > 0.02 * n * length * length) {
    const double tilt = (sums.ur - n * u * r) / uu;
    update({0, 1, 0, t}, tilt + turn * t, scatter / uu + 12 * kBatchSigma * kBatchSigma / (length * length));
  }
}

}  // namespace idol
