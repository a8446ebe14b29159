#include "idol/report/event_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "idol/base/diagnostics.hpp"
#include "idol/io/bytes.hpp"
#include "idol/io/file_writer.hpp"
#include "idol/report/run_folder.hpp"

namespace idol {
namespace {

constexpr std::string_view kMagic = "IDOLEV1\n";
constexpr float kUnitsPerPixel = 8;
constexpr float kMostPixels = 4096;  // what 15 bits of eighths hold

constexpr std::size_t kNoColour = 15;

template <class T>
void append(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::uint16_t eighths(float px) { return static_cast<std::uint16_t>((px + 0.5F) * kUnitsPerPixel); }

}  // namespace

std::string pack_events(std::span<const PictureEvent> events, int width, int height, std::size_t most,
                        std::uint32_t& shown) {
  const float right = std::min(static_cast<float>(width), kMostPixels) - 0.5F;
  const float bottom = std::min(static_cast<float>(height), kMostPixels) - 0.5F;
  std::vector<const PictureEvent*> chosen;
  const std::size_t wanted = std::min(events.size(), most);
  for (std::size_t k = 0; k < wanted; ++k) {
    const PictureEvent& e = events[k * events.size() / wanted];
    // Also false for what is not a number.
    if (e.px.x() >= -0.5F && e.px.x() < right && e.px.y() >= -0.5F && e.px.y() < bottom) chosen.push_back(&e);
  }
  std::stable_sort(chosen.begin(), chosen.end(),
                   [](const PictureEvent* a, const PictureEvent* b) { return a->id < b->id; });
  shown = static_cast<std::uint32_t>(chosen.size());
  std::string head, x, y;
  std::uint16_t groups = 0;
  for (std::size_t i = 0; i < chosen.size();) {
    const std::size_t begin = i;
    for (; i < chosen.size() && chosen[i]->id == chosen[begin]->id; ++i) {
      append(x, static_cast<std::uint16_t>(eighths(chosen[i]->px.x()) | (chosen[i]->polarity ? 0x8000 : 0)));
      append(y, eighths(chosen[i]->px.y()));
    }
    const LineId id = chosen[begin]->id;
    append(head, static_cast<std::uint32_t>(id));
    append(head, static_cast<std::uint16_t>((id == kNoLine ? kNoColour : line_colour_index(id)) << 12 |
                                            (i - begin)));
    ++groups;
  }
  std::string out;
  append(out, groups);
  return out + head + x + y;
}

void EventLog::add(Time t, std::size_t own, std::span<const PictureEvent> around) {
  if (count_++ % every_ != 0) return;
  ShownWindow window;
  window.t = t;
  window.own = static_cast<std::uint32_t>(own);
  window.around = static_cast<std::uint32_t>(around.size());
  window.packed = pack_events(around, width_, height_, kMostShownEvents, window.shown);
  bytes_ += window.packed.size();
  windows_.push_back(std::move(window));
  if (bytes_ > most_bytes_) halve();
}

void EventLog::halve() {
  std::vector<ShownWindow> kept;
  bytes_ = 0;
  for (std::size_t i = 0; i < windows_.size(); i += 2) {
    bytes_ += windows_[i].packed.size();
    kept.push_back(std::move(windows_[i]));
  }
  windows_ = std::move(kept);
  every_ *= 2;
}

void EventLog::write(const std::filesystem::path& path) const {
  FileWriter file(path);
  std::string text(kMagic);
  for (const ShownWindow& window : windows_) {
    append(text, window.t);
    append(text, window.own);
    append(text, window.around);
    append(text, window.shown);
    append(text, static_cast<std::uint32_t>(window.packed.size()));
    text += window.packed;
  }
  file.write(text.data(), text.size());
  file.close();
}

std::vector<ShownWindow> read_event_log(const std::filesystem::path& path) {
  const std::string text = read_file(path);
  if (!text.starts_with(kMagic))
    throw DataError(fmt::format("{}: is not a file of shown events", path.string()));
  ByteCursor cursor(
      {reinterpret_cast<const std::uint8_t*>(text.data()) + kMagic.size(), text.size() - kMagic.size()});
  std::vector<ShownWindow> windows;
  try {
    while (cursor.left() > 0) {
      ShownWindow window;
      window.t = cursor.get<Time>();
      window.own = cursor.get<std::uint32_t>();
      window.around = cursor.get<std::uint32_t>();
      window.shown = cursor.get<std::uint32_t>();
      window.packed = cursor.text();
      if (!windows.empty() && window.t < windows.back().t) throw BadBytes{"its stamps are not in order"};
      windows.push_back(std::move(window));
    }
  } catch (const BadBytes& bad) {
    throw DataError(fmt::format("{}: is damaged: {}", path.string(), bad.why));
  }
  return windows;
}

}  // namespace idol
