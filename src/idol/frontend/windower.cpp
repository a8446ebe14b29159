#include "idol/frontend/windower.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace idol {

void Windower::push(std::span<const Event> events) {
  for (const Event& event : events) push_one(event);
}

void Windower::begin_at(Time t) {
  if (!started_) {
    current_.begin = t;
    started_ = true;
  }
}

void Windower::leave_out_flicker(Time t) {
  begin_at(t);
  advance(t);
  ++current_.flicker;
}

void Windower::push_one(const Event& event) {
  begin_at(event.t);
  advance(event.t);
  const bool full =
      current_.events.size() - current_.overlap >= static_cast<std::size_t>(options_.max_events);
  if (full && event.t > current_.events.back().t) close(event.t);
  current_.events.push_back(event);
}

void Windower::advance(Time t) {
  if (!started_) return;
  const Time longest = from_seconds(options_.max_duration_s);
  while (t >= current_.begin + longest) close(current_.begin + longest);
}

void Windower::close(Time end) {
  current_.end = end;
  EventWindow next;
  next.begin = end;
  const std::size_t fresh = current_.events.size() - current_.overlap;
  next.overlap = static_cast<std::size_t>(std::ceil(static_cast<double>(fresh) * options_.overlap));
  next.events.assign(current_.events.end() - static_cast<std::ptrdiff_t>(next.overlap),
                     current_.events.end());
  ready_.push_back(std::exchange(current_, std::move(next)));
}

std::optional<EventWindow> Windower::pop() {
  if (ready_.empty()) return std::nullopt;
  EventWindow window = std::move(ready_.front());
  ready_.pop_front();
  return window;
}

std::optional<EventWindow> Windower::flush() {
  if (!started_ || current_.events.size() == current_.overlap) return std::nullopt;
  close(current_.events.back().t + 1);
  return pop();
}

}  // namespace idol
