#include "idol/image/tracker/line_claims.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace idol {
namespace {

constexpr float kEndMargin = kEndOutside;  // events this far beyond an end are looked at [px]
constexpr float kOnMargin = 1;             // and this far beyond, they are on the line [px]
constexpr float kReach = 2;                // distance from a line at which an event is of interest [gates]
constexpr float kNowhere = 1e9F;           // farther than any line is from any event
constexpr std::size_t kFetchAhead = 8;     // events whose memory is fetched before their turn
// Events at a time: what is known of them, 54 bytes each, stays in a first-level cache of 32 kB.
constexpr std::size_t kBlock = 256;

template <class T>
using Column = std::array<T, kBlock>;

// Events of a block: undistorted [px], from the batch's middle [s], 1 where the polarity is on, else 0; of a
// hot pixel; the lines that pass its cell.
struct EventColumns {
  Column<float> x, y, t;
  Column<std::int32_t> on;
  Column<bool> hot;
  Column<LineClaims::Names> names;
};

// And for each, of the lines named: the nearest that reaches to it and fires with its polarity, its place
// among the names, -1 for none.
struct NearestColumns {
  Column<std::int32_t> place;
  // Distances from it and from the second nearest [gates], by kReach more beyond an end; the event's place
  // along it and across it [px].
  Column<float> best, second, u, r;
  // A bit for each name: the event is inside the line's gate and extent, of whatever polarity; it is inside
  // the gate and has the polarity.
  Column<std::int32_t> own, within;
};

// Eight events at a time, against the first line that each names, then the second, ... `rows`: of each line,
// for either polarity, after two of none. There is no branch on what comes out: it is as good as random, and
// at each wrong guess a processor drops its work on the events that follow.
IDOL_WIDE void find_nearest(const EventColumns& events, std::size_t n, const LineClaims::LineRow* rows,
                            NearestColumns& out) {
  const FloatLanes zero{};
  for (std::size_t from = 0; from < n; from += kLanes) {
    FloatLanes px, py, t;
    std::memcpy(&px, &events.x[from], kLaneBytes), std::memcpy(&py, &events.y[from], kLaneBytes);
    std::memcpy(&t, &events.t[from], kLaneBytes);
    IntLanes place = IntLanes{} - 1, own{}, within{};
    FloatLanes best = zero + kNowhere, second = best, along = zero, across = zero;
    LineClaims::Names any = 0;
    for (std::size_t i = 0; i < kLanes; ++i) any |= events.names[from + i];
    for (int k = 0; any >> (k * LineClaims::kNameBits) != 0; ++k) {
      FloatLanes row[kLanes];
      for (std::size_t i = 0; i < kLanes; ++i) {
        const auto name = events.names[from + i] >> (k * LineClaims::kNameBits) & LineClaims::kNameMask;
        std::memcpy(&row[i], &rows[2 * name + static_cast<std::size_t>(events.on[from + i])], kLaneBytes);
      }
      transpose(row);
      const auto& [cx, cy, dx, dy, half, rate, turn, gate] = row;
      const FloatLanes x = px - cx, y = py - cy;
      const FloatLanes u = dx * x + dy * y, r = dx * y - dy * x - (rate + turn * u) * t;
      const FloatLanes off = (r < zero ? -r : r) / (gate < zero ? -gate : gate);
      const FloatLanes beyond = (u < zero ? -u : u) - half;
      const IntLanes near = (off < kReach) & (beyond <= kEndMargin), on = near & (beyond < kOnMargin);
      const IntLanes fits = near & (gate > zero), bit = IntLanes{} + (1 << k);
      // Lines that reach here go before those that might only grow to here.
      const FloatLanes rank = fits ? off + (on ? zero : zero + kReach) : zero + kNowhere;
      const IntLanes better = rank < best;
      const FloatLanes other = better ? best : rank;
      second = other < second ? other : second;
      best = better ? rank : best;
      place = better ? IntLanes{} + k : place;
      along = better ? u : along, across = better ? r : across;
      own |= on & (off < 1) & bit, within |= fits & (off < 1) & bit;
    }
    std::memcpy(&out.place[from], &place, kLaneBytes), std::memcpy(&out.best[from], &best, kLaneBytes);
    std::memcpy(&out.second[from], &second, kLaneBytes), std::memcpy(&out.u[from], &along, kLaneBytes);
    std::memcpy(&out.r[from], &across, kLaneBytes), std::memcpy(&out.own[from], &own, kLaneBytes);
    std::memcpy(&out.within[from], &within, kLaneBytes);
  }
}

// A line as find_nearest() reads it: the gate is negative where it does not fire with the polarity.
LineClaims::LineRow row_of(const ClaimingLine& line, float polarity) {
  const bool fits = line.expected == 0 || line.expected == polarity;
  return {line.cx, line.cy, line.dx, line.dy, line.half, line.rate, line.turn, fits ? line.gate : -line.gate};
}

ClaimingLine& named(LineClaims::Names names, int place, std::span<ClaimingLine> lines) {
  return lines[static_cast<std::size_t>(names >> (place * LineClaims::kNameBits) & LineClaims::kNameMask) -
               1];
}

// One more event, so many px beyond an end.
void count_end(EndCounts& counts, float beyond) {
  const int at = static_cast<int>(beyond + kEndInside);
  if (beyond > -kEndInside && at < counts.size()) ++counts[at];
}

void count_ends(ClaimingLine& line, float u) {
  count_end(line.at_lo, -line.half - u);
  count_end(line.at_hi, u - line.half);
}

// A piece of the line of an event grows by it, too.
void grow_piece(ClaimingLine& piece, const ClaimingLine& line, float x, float y) {
  if (std::abs(piece.dx * line.dx + piece.dy * line.dy) < LineClaims::kParallel) return;
  count_ends(piece, piece.dx * (x - piece.cx) + piece.dy * (y - piece.cy));
}

// Only the nearest line counts an event, unless a second is as near. Returns the one that it is of, if any.
ClaimingLine* settle(const EventColumns& events, const NearestColumns& nearest, std::size_t i,
                     std::span<ClaimingLine> lines) {
  const LineClaims::Names names = events.names[i];
  for (int k = 0, own = nearest.own[i]; own >> k != 0; ++k)
    if ((own >> k & 1) != 0) named(names, k, lines).contrast += events.on[i] != 0 ? 1 : -1;
  const int place = nearest.place[i];
  if (place < 0) return nullptr;
  ClaimingLine& line = named(names, place, lines);
  const float best = nearest.best[i], u = nearest.u[i], r = nearest.r[i], t = events.t[i];
  const bool on = best < kReach;
  const float off = on ? best : best - kReach;
  if (on) ++(off < LineClaims::kCoreGate ? line.core : r < 0 ? line.left : line.right);
  if (off >= 1) return nullptr;
  ClaimingLine* const owner = on ? &line : nullptr;
  if (owner) ++line.along[static_cast<int>(u - line.along_at)];
  if (nearest.second[i] < 1.5F * off + 0.33F) return owner;
  count_ends(line, u);
  for (int k = 0, others = nearest.within[i] & ~(1 << place); others >> k != 0; ++k)
    if ((others >> k & 1) != 0) grow_piece(named(names, k, lines), line, events.x[i], events.y[i]);
  if (!owner) return nullptr;
  const float v = u / std::max(0.5F, line.half);
  ++line.n;
  line.u += u, line.uu += u * u, line.r += r, line.ur += u * r, line.t += t;
  line.rr += r * r, line.rrrr += r * r * r * r;
  line.bow += r * (1.5F * v * v - 0.5F);
  return owner;
}

}  // namespace

LineClaims::LineClaims(const UndistortMap& undistort) : undistort_(&undistort) {
  const int w = undistort.width(), h = undistort.height();
  // Strong distortion can throw the corners far out: cells beyond twice the sensor are of no use.
  const Eigen::Vector2f size(static_cast<float>(w), static_cast<float>(h));
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      low_ = low_.cwiseMin(undistort(x, y));
      high_ = high_.cwiseMax(undistort(x, y));
    }
  low_ = low_.cwiseMax(-size);
  high_ = high_.cwiseMin(2 * size);
  cols_ = static_cast<int>((high_.x() - low_.x()) * kPerCell) + 1;
  rows_ = static_cast<int>((high_.y() - low_.y()) * kPerCell) + 1;
  cells_.resize(static_cast<std::size_t>(cols_) * static_cast<std::size_t>(rows_));
}

std::size_t LineClaims::claim(std::span<const Event> events, Time middle, std::span<ClaimingLine> lines,
                              std::span<const std::uint8_t> isolated, std::uint8_t hot_from, LineId* labels) {
  place_lines(lines, static_cast<float>(std::max(seconds_between(events.front().t, middle),
                                                 seconds_between(middle, events.back().t))));
  const auto width = static_cast<std::size_t>(undistort_->width());
  const auto pixel_of = [&](const Event& e) { return e.y * width + e.x; };
  rest_.resize(events.size());
  std::size_t left = 0, hot = 0;
  // Lanes beyond the last event keep what was there before, which names no line that is not there.
  EventColumns block{};
  NearestColumns nearest;
  for (std::size_t from = 0; from < events.size(); from += kBlock) {
    const std::size_t n = std::min(kBlock, events.size() - from);
    for (std::size_t k = 0; k < n; ++k) {
      const Event &e = events[from + k], &later = events[std::min(from + k + kFetchAhead, events.size() - 1)];
      __builtin_prefetch(&(*undistort_)(later.x, later.y));
      __builtin_prefetch(&isolated[pixel_of(later)]);
      const Eigen::Vector2f& px = (*undistort_)(e.x, e.y);
      block.x[k] = px.x(), block.y[k] = px.y(), block.t[k] = static_cast<float>(e.t - middle) * 1e-9F;
      block.on[k] = e.polarity ? 1 : 0;
      block.hot[k] = isolated[pixel_of(e)] >= hot_from;
      block.names[k] = block.hot[k] ? 0 : names_of(cell_at(px));
    }
    find_nearest(block, n, line_rows_.data(), nearest);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t i = from + k;
      ClaimingLine* const line = settle(block, nearest, k, lines);
      if (line) line->last = events[i].t;
      labels[i] = line ? line->id : kNoLine;
      rest_[left] = static_cast<std::uint32_t>(i);
      left += line || block.hot[k] ? 0 : 1;
      hot += block.hot[k] ? 1 : 0;
    }
  }
  rest_.resize(left);
  return hot;
}

// Where the lines of a batch are that lasts so long to either side of its middle [s].
void LineClaims::place_lines(std::span<const ClaimingLine> lines, float half_span) {
  if (++batch_ > kNameMask) {  // its stamp was used before
    std::fill(cells_.begin(), cells_.end(), 0);
    batch_ = 1;
  }
  // A cell keeps the lines that are drawn last: in reverse, so that these are the oldest.
  for (std::size_t k = lines.size(); k-- > 0;) {
    const ClaimingLine& line = lines[k];
    const float fastest = std::abs(line.rate) + std::abs(line.turn) * line.half;
    draw(k + 1, line, kReach * line.gate + std::min(4.0F, fastest * half_span));
  }
  ClaimingLine nowhere;
  nowhere.half = -kNowhere;
  line_rows_.assign(2, row_of(nowhere, 0));
  for (const ClaimingLine& line : lines)
    for (const float polarity : {-1.0F, 1.0F}) line_rows_.push_back(row_of(line, polarity));
}

// Names the line in all cells that come within `band` of it.
void LineClaims::draw(Names name, const ClaimingLine& line, float band) {
  const bool flat = std::abs(line.dx) > std::abs(line.dy);
  // In cells: walk along the longer axis; at each step those across.
  const float along = flat ? line.dx : line.dy, slope = (flat ? line.dy : line.dx) / along;
  const Eigen::Vector2f centre = (Eigen::Vector2f(line.cx, line.cy) - low_) * kPerCell;
  const float p0 = flat ? centre.x() : centre.y(), q0 = flat ? centre.y() : centre.x();
  // A short line grows step by step: where it may end in one step is enough.
  const float margin = std::clamp(0.5F * line.half, 2.5F, kEndMargin);
  const float from = p0 - (line.half + margin) * along * kPerCell,
              to = p0 + (line.half + margin) * along * kPerCell;
  const int n = flat ? cols_ : rows_, across = flat ? rows_ : cols_;
  const int step = flat ? cols_ : 1, stride = flat ? 1 : cols_;
  const float reach = band * kPerCell * std::sqrt(1 + slope * slope) + 0.5F * std::abs(slope);
  const int first = std::max(0, static_cast<int>(std::floor(std::min(from, to))));
  const int last = std::min(n - 1, static_cast<int>(std::floor(std::max(from, to))));
  const Cell stamp = batch_ << kStampShift;
  for (int i = first; i <= last; ++i) {
    const float middle = q0 + (static_cast<float>(i) + 0.5F - p0) * slope;
    // Below zero, where this is not the floor, there is no cell.
    const int low = static_cast<int>(std::max(0.0F, middle - reach));
    const int high = middle + reach < 0 ? -1 : std::min(across - 1, static_cast<int>(middle + reach));
    Cell* cell = &cells_[static_cast<std::size_t>(i * stride + low * step)];
    for (int j = low; j <= high; ++j, cell += step)
      *cell = stamp | (((names_of(*cell) << kNameBits) | name) & kNamesMask);
  }
}

}  // namespace idol
