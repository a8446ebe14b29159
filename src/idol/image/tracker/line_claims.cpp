#include "idol/image/tracker/line_claims.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

constexpr int kCell = 3;                   // cells of the image that name the lines in them [px]
constexpr float kEndMargin = kEndOutside;  // events this far beyond an end are looked at [px]
constexpr float kOnMargin = 1;             // and this far beyond, they are on the line [px]
constexpr std::size_t kFetchAhead = 8;     // events whose memory is fetched before their turn

// A line that an event is near to: along it, across it [px].
struct Candidate {
  ClaimingLine* line;
  float u, r;
};

// One more event, so many px beyond an end.
void count_end(EndCounts& counts, float beyond) {
  const int at = static_cast<int>(beyond + kEndInside);
  if (beyond > -kEndInside && at < counts.size()) ++counts[at];
}

struct EventColumns {
  const float *x, *y, *t, *polarity;  // of n events, and kLanes more that may be anything
  std::size_t n;
};

// Events that no other line is near to; `mine` gets all bits set where one is claimed. Returns the last of
// these, or -1.
IDOL_WIDE std::int32_t claim_own(const EventColumns& events, ClaimingLine& line, std::int32_t* mine) {
  constexpr IntLanes kUpwards{0, 1, 2, 3, 4, 5, 6, 7};
  constexpr int kEnds = kEndInside + kEndOutside;
  const float cx = line.cx, cy = line.cy, dx = line.dx, dy = line.dy, rate = line.rate, turn = line.turn;
  const float lo = line.lo, hi = line.hi, middle = 0.5F * (lo + hi), per_half = 2 / std::max(1.0F, hi - lo);
  const float along_at = line.along_at, expected = line.expected, gate = line.gate;
  const float outer = 2 * gate, core_gate = LineClaims::kCoreGate * gate;
  float* const along = line.along;
  const FloatLanes zero{}, nowhere = zero + kEnds;
  const IntLanes any = IntLanes{} - (expected == 0 ? 1 : 0);
  FloatLanes su{}, suu{}, sr{}, sur{}, st{}, srr{}, srrrr{}, bow{};
  IntLanes n{}, core{}, left{}, right{}, contrast{}, last = IntLanes{} - 1;
  std::array<int, kEnds + 1> at_lo{}, at_hi{};  // the last place is for all others
  for (std::size_t from = 0; from < events.n; from += kLanes) {
    FloatLanes x, y, t, polarity;
    std::memcpy(&x, events.x + from, kLaneBytes), std::memcpy(&y, events.y + from, kLaneBytes);
    std::memcpy(&t, events.t + from, kLaneBytes), std::memcpy(&polarity, events.polarity + from, kLaneBytes);
    const IntLanes index = kUpwards + static_cast<std::int32_t>(from);
    x -= cx, y -= cy;
    const FloatLanes u = dx * x + dy * y;
    const FloatLanes r = dx * y - dy * x - (rate + turn * u) * t;
    const FloatLanes off = r < zero ? -r : r;
    const IntLanes fits = any | (polarity == expected), close = off < core_gate;
    const IntLanes near = (index < static_cast<std::int32_t>(events.n)) & (off < outer);
    const IntLanes on = near & (u > lo - kOnMargin) & (u < hi + kOnMargin);
    const IntLanes own = on & (off < gate), good = own & fits;
    std::memcpy(mine + from, &good, kLaneBytes);
    last = good ? index : last;
    contrast += own & __builtin_convertvector(polarity, IntLanes);
    core -= on & fits & close;
    left -= on & fits & ~close & (r < zero), right -= on & fits & ~close & (r > zero);
    n -= good;
    const FloatLanes gu = good ? u : zero, gr = good ? r : zero, v = (u - middle) * per_half;
    su += gu, suu += gu * u, sr += gr, sur += gr * u, srr += gr * r, srrrr += gr * gr * gr * r,
        st += good ? t : zero;
    bow += gr * (1.5F * v * v - 0.5F);
    const IntLanes pixel = good & __builtin_convertvector(gu - along_at, IntLanes);
    const FloatLanes counted = good ? zero + 1 : zero;
    const IntLanes ending = near & fits & (off < gate);
    const FloatLanes beyond_lo = lo - u + kEndInside, beyond_hi = u - hi + kEndInside;
    const IntLanes is_lo = ending & (beyond_lo > zero) & (beyond_lo < kEnds);
    const IntLanes is_hi = ending & (beyond_hi > zero) & (beyond_hi < kEnds);
    const IntLanes place_lo = __builtin_convertvector(is_lo ? beyond_lo : nowhere, IntLanes);
    const IntLanes place_hi = __builtin_convertvector(is_hi ? beyond_hi : nowhere, IntLanes);
    for (std::size_t k = 0; k < kLanes; ++k) {
      along[pixel[k]] += counted[k];
      ++at_lo[static_cast<std::size_t>(place_lo[k])], ++at_hi[static_cast<std::size_t>(place_hi[k])];
    }
  }
  std::int32_t newest = -1;
  for (std::size_t k = 0; k < kLanes; ++k) {
    line.n += n[k], line.core += core[k], line.left += left[k], line.right += right[k],
        line.contrast += contrast[k];
    line.u += su[k], line.uu += suu[k], line.r += sr[k], line.ur += sur[k], line.t += st[k];
    line.rr += srr[k], line.rrrr += srrrr[k], line.bow += bow[k];
    newest = std::max(newest, last[k]);
  }
  for (std::size_t k = 0; k < kEnds; ++k) {
    line.at_lo[static_cast<Eigen::Index>(k)] += static_cast<float>(at_lo[k]);
    line.at_hi[static_cast<Eigen::Index>(k)] += static_cast<float>(at_hi[k]);
  }
  return newest;
}

}  // namespace

LineClaims::LineClaims(const UndistortMap& undistort) : width_(static_cast<std::size_t>(undistort.width())) {
  const int w = undistort.width(), h = undistort.height();
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
  cells_.resize(static_cast<std::size_t>(cols_) * static_cast<std::size_t>(rows_));
  pixels_.reserve(undistort.pixels());
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Eigen::Vector2f p = undistort(x, y), inside = p.cwiseMax(low).cwiseMin(high);
      const Eigen::Vector2i cell = ((inside - low_) / kCell).cast<int>();
      pixels_.push_back({p.x(), p.y(), static_cast<std::uint32_t>(cell.y() * cols_ + cell.x())});
    }
}

std::size_t LineClaims::claim(std::span<const Event> events, Time middle, std::span<ClaimingLine> lines,
                              std::span<const std::uint8_t> isolated, std::uint8_t hot_from, LineId* labels) {
  const auto half_span = static_cast<float>(
      std::max(seconds_between(events.front().t, middle), seconds_between(middle, events.back().t)));
  for (std::size_t k = 0; k < lines.size(); ++k) {
    const ClaimingLine& line = lines[k];
    const float fastest = std::abs(line.rate) + std::abs(line.turn) * (line.hi - line.lo) / 2;
    draw(static_cast<std::uint16_t>(k + 1), line, 2 * line.gate + std::min(4.0F, fastest * half_span));
  }
  sort_by_line(events, middle, lines.size(), isolated, hot_from);
  std::fill_n(labels, events.size(), kNoLine);
  for (std::size_t k = 0; k < lines.size(); ++k) {
    const std::size_t from = starts_[k + 1], n = starts_[k + 2] - from;
    if (n == 0) continue;
    ClaimingLine& line = lines[k];
    const std::int32_t last =
        claim_own({&x_[from], &y_[from], &t_[from], &polarity_[from], n}, line, mine_.data());
    if (last < 0) continue;
    for (std::size_t i = 0; i < n; ++i) labels[order_[from + i]] = mine_[i] != 0 ? line.id : kNoLine;
    line.last = events[order_[from + static_cast<std::size_t>(last)]].t;
  }
  const std::size_t contested = lines.size() + 1, hot = contested + 1;
  for (std::size_t at = starts_[contested]; at < starts_[hot]; ++at) {
    const std::uint32_t i = order_[at];
    if (ClaimingLine* line = claim_contested(at, cells_[pixels_[pixel_of(events[i])].cell], lines)) {
      labels[i] = line->id;
      line->last = std::max(line->last, events[i].t);
    }
  }
  for (const std::uint32_t cell : drawn_) cells_[cell] = {};
  drawn_.clear();
  // Every other event may have a line: without a branch on it this is much faster.
  rest_.resize(events.size());
  std::size_t left = 0;
  for (std::uint32_t i = 0; i < events.size(); ++i) {
    rest_[left] = i;
    left += static_cast<std::size_t>(labels[i] == kNoLine) & static_cast<std::size_t>(kinds_[i] != hot);
  }
  rest_.resize(left);
  return events.size() - starts_[hot];
}

// Names the line in all cells that come within `band` of it.
void LineClaims::draw(std::uint16_t index, const ClaimingLine& line, float band) {
  const bool flat = std::abs(line.dx) > std::abs(line.dy);
  // In cells: walk along the longer axis; at each step those across.
  const float along = flat ? line.dx : line.dy, slope = (flat ? line.dy : line.dx) / along;
  const Eigen::Vector2f centre = (Eigen::Vector2f(line.cx, line.cy) - low_) / kCell;
  const float p0 = flat ? centre.x() : centre.y(), q0 = flat ? centre.y() : centre.x();
  // A short line grows step by step: where it may end in one step is enough.
  const float margin = std::clamp(0.25F * (line.hi - line.lo), 2.5F, kEndMargin);
  const float from = p0 + (line.lo - margin) * along / kCell, to = p0 + (line.hi + margin) * along / kCell;
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
      auto& named = cells_[cell];
      if (named[0] == 0) drawn_.push_back(cell);
      for (auto& slot : named)
        if (slot == 0) {
          slot = index;
          break;
        }
    }
  }
}

void LineClaims::sort_by_line(std::span<const Event> events, Time middle, std::size_t lines,
                              std::span<const std::uint8_t> isolated, std::uint8_t hot_from) {
  const auto contested = static_cast<std::uint16_t>(lines + 1), hot = static_cast<std::uint16_t>(lines + 2);
  kinds_.resize(events.size());
  starts_.assign(lines + 4, 0);
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& soon = events[std::min(i + kFetchAhead, events.size() - 1)];
    __builtin_prefetch(&pixels_[pixel_of(soon)]);
    __builtin_prefetch(&isolated[pixel_of(soon)]);
    const std::size_t pixel = pixel_of(events[i]);
    const Cell& named = cells_[pixels_[pixel].cell];
    std::uint16_t kind = named[1] != 0 ? contested : named[0];
    kind = isolated[pixel] >= hot_from ? hot : kind;
    kinds_[i] = kind;
    ++starts_[kind + 1];
  }
  for (std::size_t k = 1; k < starts_.size(); ++k) starts_[k] += starts_[k - 1];
  order_.resize(events.size());
  for (auto* column : {&x_, &y_, &t_, &polarity_}) column->resize(events.size() + kLanes);
  mine_.resize(events.size() + kLanes);
  next_ = starts_;
  for (std::uint32_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const Pixel& px = pixels_[pixel_of(e)];
    const std::size_t at = next_[kinds_[i]]++;
    order_[at] = i;
    x_[at] = px.x, y_[at] = px.y, t_[at] = static_cast<float>(e.t - middle) * 1e-9F;
    polarity_[at] = e.polarity ? 1.0F : -1.0F;
  }
}

// Of the lines that reach to the event and fire with its polarity, the nearest by its own width; only it
// counts the event, unless a second is as near.
ClaimingLine* LineClaims::claim_contested(std::size_t at, const Cell& named,
                                          std::span<ClaimingLine> lines) const {
  std::array<Candidate, kNamed> near;
  std::size_t count = 0;
  const float polarity = polarity_[at];
  ClaimingLine* chosen = nullptr;
  float best = 2, best_r = 0, best_u = 0, second = 1e9F;  // distances in gates
  bool best_on = false;
  // Lines that reach here go before those that might only grow to here.
  for (const std::uint16_t index : named) {
    if (index == 0) break;
    ClaimingLine& line = lines[static_cast<std::size_t>(index - 1)];
    const float x = x_[at] - line.cx, y = y_[at] - line.cy;
    const float u = line.dx * x + line.dy * y;
    if (u < line.lo - kEndMargin || u > line.hi + kEndMargin) continue;
    const float r = line.dx * y - line.dy * x - (line.rate + line.turn * u) * t_[at];
    const float off = std::abs(r) / line.gate;
    if (off >= 2) continue;
    const bool on = u > line.lo - kOnMargin && u < line.hi + kOnMargin;
    if (on && off < 1) line.contrast += polarity > 0 ? 1 : -1;
    if (line.expected != 0 && line.expected != polarity) continue;
    near[count++] = {&line, u, r};
    if (on > best_on || (on == best_on && off < best)) {
      if (best_on) second = best;
      best = off, best_r = r, best_u = u, best_on = on, chosen = &line;
    } else if (on) {
      second = std::min(second, off);
    }
  }
  if (!chosen) return nullptr;
  ClaimingLine* const owner = best_on && best < 1 ? chosen : nullptr;
  if (best_on) ++(best < kCoreGate ? chosen->core : best_r < 0 ? chosen->left : chosen->right);
  if (owner) ++chosen->along[static_cast<int>(best_u - chosen->along_at)];
  if (best >= 1 || second < 1.5F * best + 0.33F) return owner;
  for (const Candidate& c : std::span(near).first(count)) {
    // A piece of the same line grows by the events of its neighbour, too.
    ClaimingLine& piece = *c.line;
    if (std::abs(c.r) >= piece.gate || std::abs(piece.dx * chosen->dx + piece.dy * chosen->dy) < kParallel)
      continue;
    count_end(piece.at_lo, piece.lo - c.u);
    count_end(piece.at_hi, c.u - piece.hi);
  }
  if (!best_on) return owner;
  const float middle = 0.5F * (chosen->lo + chosen->hi);
  const float v = 2 * (best_u - middle) / std::max(1.0F, chosen->hi - chosen->lo);
  ++chosen->n;
  chosen->u += best_u, chosen->uu += best_u * best_u, chosen->r += best_r, chosen->ur += best_u * best_r;
  chosen->t += t_[at], chosen->rr += best_r * best_r;
  chosen->rrrr += best_r * best_r * best_r * best_r;
  chosen->bow += best_r * (1.5F * v * v - 0.5F);
  return owner;
}

}  // namespace idol
