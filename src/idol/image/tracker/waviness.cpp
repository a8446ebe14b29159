#include "idol/image/tracker/waviness.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

constexpr std::size_t kMost = 360;  // events looked at, spread evenly
constexpr int kPieces = 6, kSlices = 4;
constexpr float kFew = 3;  // events that have no mean yet

// Of each event: place and time from the line's origin and middle time [px, s]; then its distance from the
// line [px] and the cell it is in, of pieces of the line and slices of the window.
struct PieceColumns {
  std::array<float, kMost> x, y, t, offset;
  std::array<int, kMost> cell;
};

void gather(const EventWindow& window, std::span<const std::uint32_t> events, const MovingLine& line,
            const UndistortMap& undistort, std::size_t n, PieceColumns& out) {
  constexpr std::size_t kFetchedAhead = 16;
  const float step = static_cast<float>(events.size()) / static_cast<float>(n);
  const auto event = [&](std::size_t k) -> const Event& {
    return window.events[events[static_cast<std::size_t>((static_cast<float>(k) + 0.5F) * step)]];
  };
  const Eigen::Vector2f origin = line.origin.cast<float>();
  const Time middle = window.begin + from_seconds(line.time);
  for (std::size_t k = 0; k < n; ++k) {
    __builtin_prefetch(&event(std::min(k + kFetchedAhead, n - 1)));
    const Event& e = event(k);
    const Eigen::Vector2f& px = undistort(e.x, e.y);
    out.x[k] = px.x() - origin.x();
    out.y[k] = px.y() - origin.y();
    out.t[k] = static_cast<float>(e.t - middle) * 1e-9F;
  }
}

// A plain loop over columns, which the compiler turns into wide registers.
IDOL_WIDE void place(const MovingLine& line, float duration, std::size_t n, PieceColumns& out) {
  const auto dx = static_cast<float>(line.direction.x()), dy = static_cast<float>(line.direction.y());
  const auto c0 = static_cast<float>(line.c[0]), c1 = static_cast<float>(line.c[1]);
  const auto c2 = static_cast<float>(line.c[2]), c3 = static_cast<float>(line.c[3]);
  const auto c4 = static_cast<float>(line.c[4]), low = static_cast<float>(line.u_min);
  const auto per_length = static_cast<float>(1 / line.length_px());
  const float per_duration = 1 / duration, first = -static_cast<float>(line.time);
  const auto part = [](float share, int parts) {
    share = share < 0 ? 0 : share;
    share = share > 0.999F ? 0.999F : share;
    return static_cast<int>(static_cast<float>(parts) * share);
  };
  for (std::size_t k = 0; k < n; ++k) {
    const float x = out.x[k], y = out.y[k], t = out.t[k];
    const float u = dx * x + dy * y;
    out.offset[k] = dx * y - dy * x - (c0 + c1 * u + (c2 + c3 * u + c4 * t) * t);
    out.cell[k] = part((u - low) * per_length, kPieces) * kSlices + part((t - first) * per_duration, kSlices);
  }
}

}  // namespace

Waviness waviness(const EventWindow& window, std::span<const std::uint32_t> events, const MovingLine& line,
                  double near, const UndistortMap& undistort) {
  if (events.empty()) return {};
  const std::size_t n = std::min(events.size(), kMost);
  PieceColumns columns;
  gather(window, events, line, undistort, n, columns);
  place(line, static_cast<float>(seconds_between(window.begin, window.end)), n, columns);
  struct Cell {
    float offsets = 0, count = 0;
  };
  std::array<Cell, static_cast<std::size_t>(kPieces * kSlices)> cells{};
  float all = 0, used = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (std::abs(columns.offset[k]) > static_cast<float>(near)) continue;
    Cell& cell = cells[static_cast<std::size_t>(columns.cell[k])];
    cell.offsets += columns.offset[k];
    cell.count += 1;
    all += columns.offset[k] * columns.offset[k];
    used += 1;
  }
  // The mean of n events scatters by itself, by their variance over n.
  const float variance = all / std::max(1.0F, used);
  float squares = 0, counted = 0;
  for (const Cell& cell : cells) {
    if (cell.count < kFew) continue;
    squares += cell.offsets * cell.offsets / cell.count - variance;
    counted += cell.count;
  }
  return {squares, counted};
}

}  // namespace idol
