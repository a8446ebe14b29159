#include "idol/image/tracker/delayed_labels.hpp"

#include <algorithm>
#include <utility>

namespace idol {

void DelayedLabels::add(EventWindow window, SegmentedWindow segments) {
  held_.push_back({std::move(window), std::move(segments)});
  for (const auto& [was, is] : held_.back().segments.validated)
    for (LabelledWindow& held : held_) {
      auto& candidates = held.segments.candidates;
      const auto it =
          std::find_if(candidates.begin(), candidates.end(), [&](const Segment& s) { return s.id == was; });
      if (it == candidates.end()) continue;
      it->id = is;
      if (it->straight)
        for (const std::uint32_t i : it->events)
          if (held.segments.ids[i] == kNoLine) held.segments.ids[i] = is;
      held.segments.segments.push_back(std::move(*it));
      candidates.erase(it);
    }
}

std::optional<LabelledWindow> DelayedLabels::pop() {
  if (held_.empty()) return std::nullopt;
  const LabelledWindow& oldest = held_.front();
  if (!oldest.segments.candidates.empty() &&
      seconds_between(oldest.window.end, held_.back().window.end) < longest_s_)
    return std::nullopt;
  return flush();
}

std::optional<LabelledWindow> DelayedLabels::flush() {
  if (held_.empty()) return std::nullopt;
  std::optional<LabelledWindow> out = std::move(held_.front());
  held_.pop_front();
  return out;
}

}  // namespace idol
