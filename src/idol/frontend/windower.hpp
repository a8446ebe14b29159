// Cuts the event stream into windows, whatever the packets it came in.
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "idol/base/options.hpp"
#include "idol/base/types.hpp"

namespace idol {

struct WindowOptions {
  int max_events = 1000000;
  double max_duration_s = 0.05;
  double overlap = 0.25;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("max_events", self.max_events, Range{100, 1e7},
          "events per window, N in the paper (III-A); without it as the cut, a bound of memory");
    visit("max_duration_s", self.max_duration_s, Range{0.005, 10},
          "longest window [s]; the paper cuts by event count alone, which in slow motion leaves the IMU "
          "alone for long");
    visit("overlap", self.overlap, Range{0.02, 0.9},
          "share of a window's events put before the next one to link segments (paper V)");
  }
};

/// Events of [begin, end), in time order. The first `overlap` ones repeat the end of the previous window.
struct EventWindow {
  Time begin = 0;
  Time end = 0;
  std::vector<Event> events;
  std::size_t overlap = 0;
  std::size_t flicker = 0;  ///< others of its time, which a filter left out: of a flickering lamp
};

/// Windows tile time without gaps from the first event on: each ends when it holds max_events (events with
/// equal stamps stay together) or lasts max_duration_s, empty or not.
class Windower {
 public:
  explicit Windower(const WindowOptions& options) : options_(options) {}

  /// Events in time order; cutting does not depend on how they are spread over calls.
  void push(std::span<const Event> events);
  /// Instead of push(): counts an event that is left out, since it is of a flickering lamp.
  void leave_out_flicker(Time t);
  /// Says that all events before `t` have been pushed: closes windows that lie before it.
  void advance(Time t);
  /// Next complete window.
  std::optional<EventWindow> pop();
  /// The window that is still filling; behind all that pop() gives.
  [[nodiscard]] const EventWindow& open() const { return current_; }
  /// The last, unfinished window.
  std::optional<EventWindow> flush();

 private:
  void close(Time end);
  void begin_at(Time t);
  void push_one(const Event& event);

  WindowOptions options_;
  bool started_ = false;
  EventWindow current_;
  std::deque<EventWindow> ready_;
};

}  // namespace idol
