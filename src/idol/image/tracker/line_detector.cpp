#include "idol/image/tracker/line_detector.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <span>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

// New events in a cell before a fit is tried there: at first, after many in vain, and after a track that was
// born there turned out to be no line.
constexpr std::uint32_t kFirstTest = 12, kLastTest = 96, kAfterRefusal = 64;
constexpr double kFadeEvery = 0.2;  // [s]: a quarter of the additional ones is forgotten

// How far back to look: so many times the span of the cell's newest events, within limits [s]. An edge makes
// some three events per pixel of its length and of its way, so that these are some pixels of motion.
constexpr std::uint32_t kRecent = 16;
constexpr float kSpans = 12, kLongestLook = 1.0F, kShortestLook = 0.002F;

// A fit: its first gate, which widens to the edge's width [px].
constexpr int kRounds = 7;
constexpr float kFirstGate = 1.4F;
constexpr float kGate = 2.5F;         // standard deviations across the line that are on it
constexpr float kTruncated = 0.911F;  // variance of a normal distribution cut off there, over its own
constexpr float kNarrowest = 0.3F;    // scatter of an edge's events across it [px]
constexpr float kPlace = 20;  // width of the place that events would fill evenly if there were no line [px]

// What makes a line.
constexpr float kFewest = 20;         // events
constexpr float kSlender = 4;         // length over scatter
constexpr float kMostBeside = 0.6F;   // events beside it, on the emptier side, over half of those on it
constexpr float kSignificant = 3.8F;  // standard deviations by which the events on it are more than by chance
constexpr float kMostBend = 0.04F;    // offset of its middle from its ends, over its length
constexpr float kBendSigmas = 2.5F;   // and standard deviations that sampling makes of it
constexpr float kBin = 2;             // pieces along it in which its events are counted [px]
constexpr int kBins = 24;
constexpr float kSparse = 0.25F;  // of the median count of a piece: where it falls below, the line ends

std::uint32_t to_us(Time t) { return static_cast<std::uint32_t>(t / 1000); }

struct Moments {
  float n = 0, x = 0, y = 0, t = 0, xx = 0, xy = 0, yy = 0, xt = 0, yt = 0, tt = 0;
};

// At a fixed time a moving line's events spread along it, and scatter across it: the covariance of (x, y)
// given t has the line's normal as the axis of its least variance. This needs no scale between time and
// space.
bool solve(const Moments& m, LineDetector::MovedLine& line) {
  if (m.n < 6) return false;
  const float share = 1 / m.n, x = m.x * share, y = m.y * share, t = m.t * share;
  float xx = m.xx * share - x * x, yy = m.yy * share - y * y, xy = m.xy * share - x * y;
  const float xt = m.xt * share - x * t, yt = m.yt * share - y * t;
  const float tt = std::max(m.tt * share - t * t, 1e-10F);
  xx -= xt * xt / tt, yy -= yt * yt / tt, xy -= xt * yt / tt;
  const float mean = 0.5F * (xx + yy), a = 0.5F * (xx - yy), half = std::sqrt(a * a + xy * xy);
  // The line is along half the angle of (a, xy); by the half-angle formula of the larger of the two.
  const float larger = std::sqrt(0.5F * (half + std::abs(a)) / half), smaller = 0.5F * xy / (half * larger);
  line.nx = a < 0 ? std::copysign(larger, -xy) : -smaller, line.ny = a < 0 ? std::abs(smaller) : larger;
  line.sigma = std::sqrt(std::max(0.0F, mean - half));
  line.v = (line.nx * xt + line.ny * yt) / tt;
  line.d = line.nx * x + line.ny * y - line.v * t;
  line.n = m.n, line.tt = tt;
  return std::isfinite(line.d) && std::isfinite(line.v);
}

}  // namespace

struct LineDetector::Columns {
  static constexpr std::size_t kMost = 9 * kKept + kLanes;
  std::array<float, kMost> x, y, t;
  std::size_t n = 0;
  std::array<std::size_t, 10> starts{};  // of each cell's

  void push(float px, float py, float s) { x[n] = px, y[n] = py, t[n] = s, ++n; }
};

namespace {

// The moments of the events within the gate.
IDOL_WIDE void add_near(const float* xs, const float* ys, const float* ts, std::size_t n,
                        const LineDetector::MovedLine& line, float gate, Moments& out) {
  constexpr IntLanes kUpwards{0, 1, 2, 3, 4, 5, 6, 7};
  const float nx = line.nx, ny = line.ny, d = line.d, v = line.v;
  const FloatLanes zero{};
  FloatLanes sn{}, sx{}, sy{}, st{}, sxx{}, sxy{}, syy{}, sxt{}, syt{}, stt{};
  for (std::size_t from = 0; from < n; from += kLanes) {
    FloatLanes x, y, t;
    std::memcpy(&x, xs + from, kLaneBytes), std::memcpy(&y, ys + from, kLaneBytes);
    std::memcpy(&t, ts + from, kLaneBytes);
    const FloatLanes r = nx * x + ny * y - d - v * t;
    const IntLanes in = (r < gate) & (r > -gate) &
                        (kUpwards + static_cast<std::int32_t>(from) < static_cast<std::int32_t>(n));
    x = in ? x : zero, y = in ? y : zero, t = in ? t : zero;
    sn += in ? zero + 1 : zero;
    sx += x, sy += y, st += t, sxx += x * x, sxy += x * y, syy += y * y, sxt += x * t, syt += y * t;
    stt += t * t;
  }
  for (std::size_t k = 0; k < kLanes; ++k) {
    out.n += sn[k], out.x += sx[k], out.y += sy[k], out.t += st[k], out.xx += sxx[k], out.xy += sxy[k];
    out.yy += syy[k], out.xt += sxt[k], out.yt += syt[k], out.tt += stt[k];
  }
}

float gate_of(float sigma) {
  return std::clamp(kGate * sigma, static_cast<float>(EdgeLimits::kLeastGate),
                    static_cast<float>(EdgeLimits::kMostGate));
}

}  // namespace

LineDetector::LineDetector(const UndistortMap& undistort)
    : undistort_(&undistort),
      cols_((undistort.width() + kCell - 1) / kCell),
      rows_((undistort.height() + kCell - 1) / kCell) {
  for (auto& cells : cells_) cells.resize(static_cast<std::size_t>(cols_ * rows_));
  for (auto& cells : cells_)
    for (Cell& cell : cells) cell.wanted = kFirstTest;
}

void LineDetector::begin_batch(Time begin, double most, double min_length, double noise) {
  min_length_ = min_length, noise_ = noise;
  if (begin >= next_fade_) {
    for (auto& cells : cells_)
      for (Cell& cell : cells) cell.wanted = std::max(kFirstTest, cell.wanted - cell.wanted / 4);
    next_fade_ = begin + from_seconds(kFadeEvery);
  }
  seeds_.clear();
  stride_ = 1 + static_cast<std::int64_t>(static_cast<double>(candidates_) / std::max(1.0, most));
  candidates_ = 0;
}

void LineDetector::add(const Event& event) {
  if (candidates_++ % stride_ != 0) {
    ++skipped_;
    return;
  }
  const int col = event.x / kCell, row = event.y / kCell, polarity = event.polarity ? 1 : 0;
  Cell& mine = cell(col, row, polarity);
  const Eigen::Vector2f& px = (*undistort_)(event.x, event.y);
  mine.points[mine.count % kKept] = {px.x(), px.y(), to_us(event.t)};
  ++mine.count;
  if (mine.count - mine.tested < mine.wanted) return;
  mine.tested = mine.count;
  if (test(col, row, polarity, event))
    mine.wanted = kFirstTest;
  else
    mine.wanted = std::min(kLastTest, mine.wanted + mine.wanted / 2);
}

void LineDetector::discourage(const Eigen::Vector2d& px) {
  const int col = static_cast<int>(px.x()) / kCell, row = static_cast<int>(px.y()) / kCell;
  for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r)
    for (int c = std::max(0, col - 1); c <= std::min(cols_ - 1, col + 1); ++c)
      for (int polarity : {0, 1}) cell(c, r, polarity).wanted = kAfterRefusal;
}

void LineDetector::gather(int col, int row, int polarity, std::uint32_t now, Columns& out) const {
  constexpr std::array<std::array<int, 2>, 9> kAround{
      {{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}, {-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
  const Cell& mine = cell(col, row, polarity);
  const std::uint32_t last = mine.count - 1;
  const std::uint32_t back = std::min(mine.held() - 1, kRecent - 1);
  const Point& earlier = mine.points[(last - back) % kKept];
  const float look = std::clamp(kSpans * static_cast<float>(now - earlier.us) * 1e-6F *
                                    (static_cast<float>(kRecent) / static_cast<float>(back + 1)),
                                kShortestLook, kLongestLook);
  const Eigen::Vector2f middle{mine.points[last % kKept].x, mine.points[last % kKept].y};
  for (std::size_t k = 0; k < kAround.size(); ++k) {
    out.starts[k] = out.n;
    const int c = col + kAround[k][0], r = row + kAround[k][1];
    if (c < 0 || r < 0 || c >= cols_ || r >= rows_) continue;
    const Cell& other = cell(c, r, polarity);
    for (std::uint32_t i = 0, n = other.held(); i < n; ++i) {  // the newest first
      const Point& p = other.points[(other.count - 1 - i) % kKept];
      const float age = static_cast<float>(static_cast<std::int32_t>(now - p.us)) * 1e-6F;
      if (age > look || age < 0) break;
      out.push(p.x - middle.x(), p.y - middle.y(), -age);
    }
  }
  out.starts[9] = out.n;
}

// The best of some fits: from the newest events of the cell, all of them, those of it and of its neighbours
// to either side. Each goes from a narrow gate, which widens to the edge's width and no further: a second
// edge beside stays out.
LineDetector::MovedLine LineDetector::fit(const Columns& columns) {
  using Span = std::array<std::size_t, 2>;
  MovedLine best;
  float best_score = 0;
  const auto try_from = [&](std::span<const Span> spans) {
    Moments moments;
    for (const auto& [from, to] : spans)
      if (to > from)
        add_near(&columns.x[from], &columns.y[from], &columns.t[from], to - from, MovedLine{}, 1e6F, moments);
    MovedLine line;
    if (!solve(moments, line)) return;
    float gate = kFirstGate, before = 0;
    for (int round = 0; round < kRounds; ++round) {
      Moments near;
      add_near(columns.x.data(), columns.y.data(), columns.t.data(), columns.n, line, gate, near);
      if (near.n < kFewest / 2 || !solve(near, line)) return;
      gate = gate_of(line.sigma / std::sqrt(kTruncated));
      if (near.n == before) break;
      before = near.n;
    }
    if (line.n < kFewest) return;
    line.sigma = std::max(kNarrowest, line.sigma / std::sqrt(kTruncated));
    // By how much a normal distribution across the line explains its events better than an even one over the
    // place does: sqrt(2 pi e) sigma is the width of an even one of the same entropy.
    const float score = line.n * std::log(kPlace / (4.13F * line.sigma));
    if (score > best_score) best_score = score, best = line;
  };
  const auto& starts = columns.starts;
  const std::size_t own = starts[1];
  try_from(std::array<Span, 1>{Span{0, std::min<std::size_t>(own, 24)}});
  try_from(std::array<Span, 1>{Span{0, own}});
  try_from(std::array<Span, 1>{Span{0, starts[3]}});
  try_from(std::array<Span, 2>{Span{0, own}, Span{starts[3], starts[5]}});
  return best;
}

// Where along the line its events are, and how many lie beside it there.
LineDetector::Profile LineDetector::profile(const Columns& columns, const MovedLine& line) {
  const float gate = gate_of(line.sigma), dx = line.ny, dy = -line.nx;
  std::array<int, kBins> on{}, left{}, right{};
  std::array<float, kBins> offsets{};
  for (std::size_t i = 0; i < columns.n; ++i) {
    const float u = dx * columns.x[i] + dy * columns.y[i];
    const float r = line.nx * columns.x[i] + line.ny * columns.y[i] - line.d - line.v * columns.t[i];
    const int bin = static_cast<int>(std::floor(u / kBin)) + kBins / 2;
    if (bin < 0 || bin >= kBins || std::abs(r) > 2 * gate) continue;
    const auto at = static_cast<std::size_t>(bin);
    if (std::abs(r) < gate) offsets[at] += r;
    ++(std::abs(r) < gate ? on : r < 0 ? left : right)[at];
  }
  // From the fullest piece to both sides.
  std::array<int, kBins> filled{};
  const auto end = std::copy_if(on.begin(), on.end(), filled.begin(), [](int n) { return n > 0; });
  const auto median = filled.begin() + (end - filled.begin()) / 2;
  std::nth_element(filled.begin(), median, end);
  const float least = kSparse * static_cast<float>(*median);
  const auto full = [&](std::ptrdiff_t k) {
    return k >= 0 && k<kBins&& static_cast<float>(on[static_cast<std::size_t>(k)])> least;
  };
  std::ptrdiff_t from = std::max_element(on.begin(), on.end()) - on.begin(), to = from;
  while (full(from - 1) || full(from - 2)) --from;
  while (full(to + 1) || full(to + 2)) ++to;
  Profile out;
  out.middle = kBin * (0.5F * static_cast<float>(from + to + 1) - kBins / 2);
  out.length = kBin * static_cast<float>(to - from + 1) - 1;
  int to_left = 0, to_right = 0;
  float middle_n = 0, middle_r = 0, outer_n = 0, outer_r = 0;
  for (std::ptrdiff_t k = from; k <= to; ++k) {
    const auto at = static_cast<std::size_t>(k);
    out.on += on[at], to_left += left[at], to_right += right[at];
    const bool outer = 3 * (k - from) < to - from || 3 * (to - k) < to - from;
    (outer ? outer_n : middle_n) += static_cast<float>(on[at]);
    (outer ? outer_r : middle_r) += offsets[at];
  }
  out.beside = 2 * std::min(to_left, to_right);  // another edge may pass on one side
  if (middle_n > 0 && outer_n > 0) {
    out.bend = std::abs(middle_r / middle_n - outer_r / outer_n);
    out.bend_sigma = line.sigma * std::sqrt(1 / middle_n + 1 / outer_n);
  }
  return out;
}

bool LineDetector::is_line(const MovedLine& line, const Profile& profile) {
  const auto refused = [](std::int64_t& counter) {
    ++counter;
    return false;
  };
  if (line.n < kFewest) return refused(counts_.few);
  if (line.sigma > static_cast<float>(EdgeLimits::kMostSigma)) return refused(counts_.wide);
  const auto on = static_cast<float>(profile.on), beside = static_cast<float>(profile.beside);
  // Noise of this polarity on the line, in the time that its events span.
  const float by_chance =
      static_cast<float>(0.5 * noise_) * profile.length * 2 * gate_of(line.sigma) * std::sqrt(12 * line.tt);
  if (on < kFewest || on < 2 * by_chance + kSignificant * std::sqrt(by_chance)) return refused(counts_.few);
  if (beside > kMostBeside * on || on - beside < kSignificant * std::sqrt(on + beside))
    return refused(counts_.texture);
  if (profile.length < static_cast<float>(min_length_) || profile.length < kSlender * line.sigma)
    return refused(counts_.brief);
  // What the scatter of its events makes of a bend by chance is allowed for.
  if (profile.bend > kMostBend * profile.length + kBendSigmas * profile.bend_sigma)
    return refused(counts_.bent);
  return true;
}

bool LineDetector::test(int col, int row, int polarity, const Event& newest) {
  const std::uint32_t now = to_us(newest.t);
  Columns columns;
  gather(col, row, polarity, now, columns);
  ++counts_.fits;
  const MovedLine line = static_cast<float>(columns.n) < kFewest ? MovedLine{} : fit(columns);
  const Profile along = line.n < kFewest ? Profile{} : profile(columns, line);
  if (!is_line(line, along)) return false;
  const Cell& mine = cell(col, row, polarity);
  const Point origin = mine.points[(mine.count - 1) % kKept];
  LineSeed seed;
  seed.time = newest.t;
  seed.normal = Eigen::Vector2d(line.nx, line.ny);
  seed.centre = Eigen::Vector2d(origin.x, origin.y) + along.middle * Eigen::Vector2d(line.ny, -line.nx) +
                line.d * seed.normal;
  seed.speed = line.v;
  seed.speed_sigma = line.sigma / std::sqrt(line.n * line.tt);
  seed.sigma = line.sigma;
  seed.length = along.length;
  seed.polarity = newest.polarity;
  seeds_.push_back(seed);
  ++counts_.seeds;
  for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r)
    for (int c = std::max(0, col - 1); c <= std::min(cols_ - 1, col + 1); ++c)
      remove(cell(c, r, polarity), line, origin, now);
  return true;
}

// The events of a line that was found make no second one.
void LineDetector::remove(Cell& cell, const MovedLine& line, const Point& origin, std::uint32_t now) {
  const float gate = gate_of(line.sigma);
  const std::uint32_t n = cell.held(), first = cell.count - n;
  std::uint32_t kept = 0;
  for (std::uint32_t i = 0; i < n; ++i) {
    const Point p = cell.points[(first + i) % kKept];
    const float age = static_cast<float>(static_cast<std::int32_t>(now - p.us)) * 1e-6F;
    const float off = line.nx * (p.x - origin.x) + line.ny * (p.y - origin.y) - line.d + line.v * age;
    if (std::abs(off) < gate) continue;
    cell.points[(first + kept++) % kKept] = p;
  }
  cell.count = first + kept;
  cell.tested = std::min(cell.tested, cell.count);
}

}  // namespace idol
