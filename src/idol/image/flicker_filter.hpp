// Tells the events of a flickering lamp from those of motion.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "idol/base/types.hpp"
#include "idol/image/flicker_analysis.hpp"

namespace idol {

/// Lamps on the mains flicker at 100 or 120 Hz: all over what they light, pixels fire ON while the light
/// grows and OFF while it fades, at the same phases of each period. An edge that moves fires at any phase,
/// and only where it is. Every 20 ms the filter looks at the last 0.16 s (FlickerAnalysis); where it finds
/// flicker, events of its phases and polarity are left out, but for two kinds that are of edges: those of a
/// place where, by the events at the other phases, an edge makes more events than the flicker, and further
/// ones of a pixel that has had its event of flicker in this half period.
///
/// Bounded memory. The result depends on the sequence of events alone, not on how it is spread over calls.
class FlickerFilter {
 public:
  FlickerFilter(int width, int height);

  /// An event, in time order. `take(event, is_flicker)` gets all events in order: at once, but for the first
  /// 0.2 s of the stream, which are held back until it is known whether the light flickers.
  template <class Take>
  void push(const Event& event, Take&& take) {
    const bool inside = event.x < grid_.width && event.y < grid_.height;
    if (event.t >= row_end_) advance(event.t);
    if (inside) {
      ++row_[grid_.channel(event)];
      ++hop_[grid_.cell(event)];
    }
    if (holding_) {
      held_.push_back(event);
      holding_ = held_.size() < kMostHeld;
    } else {
      if (!held_.empty()) release(take);
      take(event, inside && judge(event));
    }
  }
  /// At the end of the stream: hands over what is still held back.
  template <class Take>
  void finish(Take&& take) {
    holding_ = false;
    release(take);
  }

  /// True while flicker is left out.
  [[nodiscard]] bool active() const { return active_; }
  /// Of the flicker found last [Hz]; 0: none so far.
  [[nodiscard]] double frequency_hz() const { return frequency_hz_; }

 private:
  // Events of one polarity in a block of pixels that are not at the flicker's phases, by its periods.
  struct Block {
    std::uint32_t period = 0;
    std::uint16_t now = 0, before = 0;
  };

  template <class Take>
  void release(Take&& take) {
    for (const Event& event : std::exchange(held_, {}))
      take(event, event.x < grid_.width && event.y < grid_.height && judge(event));
  }
  bool judge(const Event& event) {
    if (!active_) return false;
    const std::size_t channel = grid_.channel(event);
    return has_flicker_[channel] != 0 && is_flicker(event, channel);
  }
  [[nodiscard]] std::uint64_t phase_at(Time t) const {
    return anchor_phase_ + static_cast<std::uint64_t>(((t - anchor_) * phase_per_ns_) >> 16);
  }
  bool is_flicker(const Event& event, std::size_t channel);
  bool is_repeated(const Event& event, std::size_t channel, std::uint64_t phase);
  void advance(Time t);
  void restart(Time t);
  void analyse();
  [[nodiscard]] bool detect();
  void set_phase(double hz);
  void set_thresholds();
  void set_bursts();

  static constexpr int kBlockShift = 2;  // blocks of 4 x 4 px
  static constexpr std::size_t kMostHeld = std::size_t{1} << 22;

  TileGrid grid_;
  FlickerAnalysis analysis_;
  std::uint16_t* row_ = nullptr;  // counts at hand, in the analysis
  std::uint32_t* hop_ = nullptr;
  Time row_end_ = INT64_MIN;
  int rows_in_hop_ = 0, hops_ = 0;
  bool started_ = false, holding_ = true, active_ = false;
  std::vector<Event> held_;
  int found_ = 0, missed_ = 0;  // analyses on end that saw flicker of one frequency, or none
  double last_hz_ = 0, frequency_hz_ = 0;
  Time anchor_ = 0;
  std::uint64_t anchor_phase_ = 0;         // at that time, in periods times 2^32
  std::int64_t phase_per_ns_ = 0;          // times 2^48
  std::vector<std::uint8_t> has_flicker_;  // by channel
  std::vector<float> thresholds_;          // by channel and phase; 0: no flicker at this phase
  std::size_t blocks_across_;
  std::vector<Block> blocks_;  // by polarity and place
  // A burst is a period's flicker of one polarity.
  std::vector<std::uint32_t> last_burst_;       // by pixel: the last one that it had an event in
  std::array<std::uint64_t, 2> burst_begin_{};  // by polarity: phase, in periods times 2^32
  std::vector<std::uint8_t> only_flicker_;      // by channel: no other events to speak of
  std::int64_t firsts_ = 0, repeats_ = 0;       // there, since the last analysis: events by pixel and burst
  bool fires_once_ = false;                     // there is hardly more than one event by pixel and burst
};

}  // namespace idol
