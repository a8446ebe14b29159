#include "idol/image/flicker_filter.hpp"

#include <algorithm>
#include <cmath>

namespace idol {
namespace {

// Frequencies that mains of 50 and 60 Hz give, with a wide margin; what two analyses of one lamp may differ
// by.
constexpr double kLeastFlickerHz = 86, kMostFlickerHz = 134, kSameHz = 1.5;
// Prominence of flicker that is new, and of flicker that is known. Periodic light has 15 or more even where
// it is weak, pulses at random times have less than 12.
constexpr float kNewProminence = 12, kKnownProminence = 4;
// Of all tiles one in `kTilesShare` must show flicker; of those that do, one in `kEvenShare` must be full of
// it.
constexpr int kTilesShare = 24, kEvenShare = 4;
constexpr int kConfirmations = 2, kMisses = 6;  // consecutive analyses that begin and end the filtering
constexpr int kHeldHops = 9;                    // at the beginning: as long as a first decision can take
constexpr float kNegligible = 0.25F;            // flicker at a phase, by the other events at it
constexpr float kNearlyAll = 0.7F;              // of the pixels fire in a burst
constexpr double kFewRepeats = 0.1;    // events of a pixel and burst after the first, by the first ones
constexpr int kPhaseShift = 27;        // of a phase in 2^32 parts
constexpr float kLeastPassing = 1.5F;  // events in a block and period; an edge makes more

}  // namespace

FlickerFilter::FlickerFilter(int width, int height)
    : grid_(width, height),
      analysis_(grid_),
      has_flicker_(grid_.channels()),
      thresholds_(grid_.channels() * FlickerAnalysis::kPhases),
      blocks_across_(static_cast<std::size_t>(width >> kBlockShift) + 1),
      blocks_(2 * blocks_across_ * (static_cast<std::size_t>(height >> kBlockShift) + 1)),
      last_burst_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)),
      only_flicker_(grid_.channels()) {}

void FlickerFilter::restart(Time t) {
  started_ = true;
  active_ = false;
  found_ = 0;
  rows_in_hop_ = 0;
  analysis_.clear();
  row_ = analysis_.next_row();
  hop_ = analysis_.next_hop();
  row_end_ = t + FlickerAnalysis::kRow_ns;
}

void FlickerFilter::advance(Time t) {
  constexpr Time kLongestPause =
      FlickerAnalysis::kRow_ns * FlickerAnalysis::kHopRows * FlickerAnalysis::kMostHops;
  if (!started_ || t - row_end_ > kLongestPause) {
    if (started_) holding_ = false;
    restart(t);
    return;
  }
  for (; t >= row_end_; row_end_ += FlickerAnalysis::kRow_ns) {
    if (++rows_in_hop_ == FlickerAnalysis::kHopRows) {
      rows_in_hop_ = 0;
      analyse();
      hop_ = analysis_.next_hop();
    }
    row_ = analysis_.next_row();
  }
}

// True if there is flicker whose frequency is sure.
bool FlickerFilter::detect() {
  const auto seen = analysis_.find();
  const int enough = std::max(4, static_cast<int>(grid_.tiles) / kTilesShare);
  bool flickers = seen && seen->prominence >= (active_ ? kKnownProminence : kNewProminence) &&
                  seen->frequency_hz >= kLeastFlickerHz && seen->frequency_hz <= kMostFlickerHz &&
                  seen->tiles >= enough;
  // Once it is known, edges may come before it: then it need not fill tiles any more.
  if (flickers && !active_) flickers = seen->even_tiles >= std::max(enough, seen->tiles / kEvenShare);
  if (flickers) {
    found_ = found_ > 0 && std::abs(seen->frequency_hz - last_hz_) < kSameHz ? found_ + 1 : 1;
    missed_ = 0;
    last_hz_ = seen->frequency_hz;
  } else {
    found_ = 0;
    ++missed_;
  }
  return found_ >= kConfirmations;
}

// At the end of a hop.
void FlickerFilter::analyse() {
  if (detect()) {
    set_phase(last_hz_);
    analysis_.separate(last_hz_, static_cast<double>(static_cast<std::uint32_t>(anchor_phase_)) * 0x1p-32);
    set_thresholds();
    set_bursts();
    active_ = true;
  } else if (missed_ >= kMisses) {
    active_ = false;
  }
  if (active_ || ++hops_ >= kHeldHops) holding_ = false;
}

// While flicker is followed its phase goes on, for the counts of the blocks and the pixels' bursts.
void FlickerFilter::set_phase(double hz) {
  constexpr std::uint64_t kPeriod = std::uint64_t{1} << 32;
  anchor_phase_ = active_ ? phase_at(row_end_) : anchor_phase_ + 2 * kPeriod;
  anchor_ = row_end_;
  phase_per_ns_ = std::llround(hz / kNsPerS * 0x1p48);
  frequency_hz_ = hz;
}

// Of the events of a block and a period that are at phases without flicker: an edge that makes so many makes
// as many as the flicker at this phase.
void FlickerFilter::set_thresholds() {
  constexpr std::size_t kPhases = FlickerAnalysis::kPhases;
  constexpr float kBlockArea_px = 1 << 2 * kBlockShift;
  for (std::size_t c = 0; c < grid_.channels(); ++c) {
    const FlickerAnalysis::Profile& flicker = analysis_.flicker(c);
    const float negligible = kNegligible * analysis_.others(c) / kPhases;
    const auto free = std::count_if(flicker.begin(), flicker.end(), [&](float f) { return f <= negligible; });
    has_flicker_[c] = free < std::ssize(flicker) ? 1 : 0;
    const float per_block = kBlockArea_px / grid_.area_px(c % grid_.tiles) * static_cast<float>(free);
    for (std::size_t b = 0; b < kPhases; ++b)
      thresholds_[c * kPhases + b] =
          flicker[b] <= negligible ? 0 : std::max(kLeastPassing, flicker[b] * per_block);
  }
}

bool FlickerFilter::is_flicker(const Event& e, std::size_t channel) {
  static_assert(FlickerAnalysis::kPhases == 1 << (32 - kPhaseShift));
  const std::uint64_t phase = phase_at(e.t);
  const auto period = static_cast<std::uint32_t>(phase >> 32), within = static_cast<std::uint32_t>(phase);
  Block& block = blocks_[(e.polarity ? blocks_.size() / 2 : 0) +
                         static_cast<std::size_t>(e.y >> kBlockShift) * blocks_across_ +
                         static_cast<std::size_t>(e.x >> kBlockShift)];
  if (period != block.period) {
    block.before = period == block.period + 1 ? block.now : 0;
    block.now = 0;
    block.period = period;
  }
  const float threshold = thresholds_[channel * FlickerAnalysis::kPhases + (within >> kPhaseShift)];
  if (threshold == 0) {
    if (block.now < UINT16_MAX) ++block.now;
    return false;
  }
  const float left = 1 - static_cast<float>(within) * 0x1p-32F;  // of the period
  if (static_cast<float>(block.before) * left + static_cast<float>(block.now) > threshold) return false;
  return !is_repeated(e, channel, phase) || !fires_once_;
}

// Under a lamp for which nearly all pixels fire, and only once, while its light grows, or fades, a second
// event is of an edge (or the first one was; which of them is left out matters little). A burst begins amid
// the quiet phases.
void FlickerFilter::set_bursts() {
  constexpr std::int64_t kEnough = 200;
  float amount = 0, area_px = 0;
  for (std::size_t c = 0; c < grid_.channels(); ++c) {
    only_flicker_[c] = analysis_.only_flicker(c % grid_.tiles) ? 1 : 0;
    if (only_flicker_[c] == 0) continue;
    for (const float share : analysis_.flicker(c)) amount += share;
    area_px += grid_.area_px(c % grid_.tiles);
  }
  if (firsts_ >= kEnough)
    fires_once_ = static_cast<double>(repeats_) < kFewRepeats * static_cast<double>(firsts_) &&
                  amount > kNearlyAll * area_px;
  firsts_ = repeats_ = 0;
  for (std::size_t polarity = 0; polarity < 2; ++polarity)
    burst_begin_[polarity] =
        static_cast<std::uint64_t>(analysis_.quiet_phase(polarity) + FlickerAnalysis::kPhases * 3 / 16)
        << kPhaseShift;
}

bool FlickerFilter::is_repeated(const Event& e, std::size_t channel, std::uint64_t phase) {
  const std::size_t polarity = e.polarity ? 1 : 0;
  const auto burst = static_cast<std::uint32_t>((phase - burst_begin_[polarity]) >> 32) * 2 +
                     static_cast<std::uint32_t>(polarity);
  std::uint32_t& last =
      last_burst_[static_cast<std::size_t>(e.y) * static_cast<std::size_t>(grid_.width) + e.x];
  const bool repeated = last == burst;
  last = burst;
  if (only_flicker_[channel] != 0) ++(repeated ? repeats_ : firsts_);
  return repeated;
}

}  // namespace idol
