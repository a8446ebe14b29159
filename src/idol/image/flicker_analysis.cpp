#include "idol/image/flicker_analysis.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

#include "idol/base/wide.hpp"

namespace idol {
namespace {

constexpr int kMostTilesAcross = 24;
// Frequencies looked at. A step is less than half the width of a line; what is farther from a line than ten
// hertz (of eight hops; of fewer, in proportion) is not part of it.
constexpr double kFirstHz = 70, kStepHz = 2.5, kLineHz = 10;
constexpr std::size_t kFrequencies = 33;
constexpr double frequency_hz(std::size_t i) { return kFirstHz + kStepHz * static_cast<double>(i); }
constexpr float kLeastEvents = 8;        // of a tile in half of the time
constexpr float kCoherence = 0.35F;      // of a tile's events in each half, if they follow an oscillation
constexpr float kMostCoherence = 0.55F;  // if hardly any do not; of a sine's half waves it is 0.79
constexpr float kSamePhase = 0.5F;       // cosine
constexpr float kUnevenness = 0.25F;     // variance of a tile's cells beyond chance, by their mean's square
constexpr float kLeastDensity = 0.05F;   // events per pixel and hop

IDOL_WIDE void add_row(const std::uint16_t* off, const std::uint16_t* on, float* difference, float* sum,
                       std::size_t n) {
  for (std::size_t k = 0; k < n; ++k) {
    const int a = on[k], b = off[k];
    difference[k] += static_cast<float>(a - b);
    sum[k] += static_cast<float>(a + b);
  }
}

// Sums eight neighbours' signals, each column rotated.
IDOL_WIDE void sum_rotated(const float* signal, std::size_t stride, const std::complex<float>* rotations,
                           int columns, float* re_out, float* im_out) {
  FloatLanes re{}, im{};
  for (int j = 0; j < columns; ++j) {
    FloatLanes x;
    std::memcpy(&x, signal + static_cast<std::size_t>(j) * stride, sizeof x);
    re += rotations[j].real() * x;
    im += rotations[j].imag() * x;
  }
  std::memcpy(re_out, &re, sizeof re);
  std::memcpy(im_out, &im, sizeof im);
}

}  // namespace

TileGrid::TileGrid(int image_width, int image_height) : width(image_width), height(image_height) {
  while ((width - 1) >> shift >= kMostTilesAcross) ++shift;
  nx = static_cast<std::size_t>((width - 1) >> shift) + 1;
  ny = static_cast<std::size_t>((height - 1) >> shift) + 1;
  tiles = nx * ny;
}

float TileGrid::area_px(std::size_t tile) const {
  const int x = static_cast<int>(tile % nx) << shift, y = static_cast<int>(tile / nx) << shift;
  return static_cast<float>(std::min(width - x, 1 << shift) * std::min(height - y, 1 << shift));
}

FlickerAnalysis::FlickerAnalysis(const TileGrid& grid)
    : grid_(grid),
      history_(kHistory * grid.channels()),
      cells_(kMostHops * grid.cells()),
      stride_((grid.tiles + kLanes - 1) / kLanes * kLanes),
      signal_(kMostColumns * stride_),
      found_(grid.tiles),
      folded_(grid.channels()),
      flicker_(grid.channels()),
      totals_(grid.channels()),
      amounts_(grid.channels()),
      errors_(grid.channels()),
      others_(grid.channels()) {
  for (Column& count : counts_) count.resize(grid.tiles);
  for (std::size_t i = 0; i < kFrequencies; ++i) {
    const auto of_one = rotations(frequency_hz(i));
    rotations_.insert(rotations_.end(), of_one.begin(), of_one.end());
  }
}

std::vector<std::complex<float>> FlickerAnalysis::rotations(double hz) {
  std::vector<std::complex<float>> out;
  for (int j = 0; j < kMostColumns; ++j) {
    const double t = (j + 0.5) * kDecimation * static_cast<double>(kRow_ns) / kNsPerS;
    const double phase = 2 * std::numbers::pi * hz * t;
    out.emplace_back(static_cast<float>(std::cos(phase)), static_cast<float>(-std::sin(phase)));
  }
  return out;
}

std::uint16_t* FlickerAnalysis::next_row() {
  newest_row_ = (newest_row_ + 1) % kHistory;
  rows_ = std::min(rows_ + 1, kHistory);
  std::uint16_t* const begin = &history_[static_cast<std::size_t>(newest_row_) * grid_.channels()];
  std::fill_n(begin, grid_.channels(), std::uint16_t{0});
  return begin;
}

std::uint32_t* FlickerAnalysis::next_hop() {
  newest_hop_ = (newest_hop_ + 1) % kMostHops;
  std::uint32_t* const begin = &cells_[static_cast<std::size_t>(newest_hop_) * grid_.cells()];
  std::fill_n(begin, grid_.cells(), 0U);
  return begin;
}

void FlickerAnalysis::clear() {
  rows_ = 0;
  std::fill(cells_.begin(), cells_.end(), 0U);
}

// That can be looked at: an even number, so that there are two halves.
int FlickerAnalysis::hops() const { return std::min(rows_ / kHopRows, kMostHops) / 2 * 2; }

const std::uint16_t* FlickerAnalysis::row(int age) const {
  const int index = (newest_row_ - age + kHistory) % kHistory;
  return &history_[static_cast<std::size_t>(index) * grid_.channels()];
}

void FlickerAnalysis::sum_rows() {
  const std::size_t tiles = grid_.tiles;
  const int rows = hops() * kHopRows;
  std::fill(signal_.begin(), signal_.end(), 0.0F);
  for (Column& count : counts_) std::fill(count.begin(), count.end(), 0.0F);
  for (int age = 0; age < rows; ++age) {
    const std::uint16_t* const off = row(age);
    add_row(off, off + tiles, &signal_[static_cast<std::size_t>((rows - 1 - age) / kDecimation) * stride_],
            counts_[age < rows / 2 ? 1 : 0].data(), tiles);
  }
}

// Phases of both halves count from the beginning of the older one.
FlickerAnalysis::Demodulated FlickerAnalysis::demodulate(
    std::span<const std::complex<float>> rotations) const {
  const int columns = hops() * kHopRows / kDecimation / 2;
  Demodulated out;
  for (std::size_t half = 0; half < 2; ++half) {
    const std::size_t first = half * static_cast<std::size_t>(columns);
    for (std::size_t k = 0; k < stride_; k += kLanes) {
      std::array<float, kLanes> re{}, im{};
      sum_rotated(&signal_[first * stride_ + k], stride_, &rotations[first], columns, re.data(), im.data());
      for (std::size_t i = 0; i < kLanes; ++i) out.halves[half].emplace_back(re[i], im[i]);
    }
  }
  return out;
}

bool FlickerAnalysis::has_votes(std::size_t tile) const {
  return std::min(counts_[0][tile], counts_[1][tile]) >= kLeastEvents;
}

// Flicker spreads over a tile as evenly as chance allows, in each hop. Edges do not; yet a lamp that is too
// weak to make events of its own may decide when those of edges come, and they must stay.
bool FlickerAnalysis::is_even(std::size_t tile) const {
  constexpr std::size_t kSide = std::size_t{1} << TileGrid::kCellsShift, kCells = kSide * kSide;
  const std::size_t x = tile % grid_.nx * kSide, y = tile / grid_.nx * kSide;
  float all = 0, beyond_chance = 0, mean_squares = 0;
  for (int age = 0; age < hops(); ++age) {
    const auto hop = static_cast<std::size_t>((newest_hop_ - age + kMostHops) % kMostHops);
    const std::uint32_t* const cells = &cells_[hop * grid_.cells() + y * grid_.nx * kSide + x];
    float sum = 0, squares = 0;
    for (std::size_t v = 0; v < kSide; ++v)
      for (std::size_t u = 0; u < kSide; ++u) {
        const auto n = static_cast<float>(cells[v * grid_.nx * kSide + u]);
        sum += n;
        squares += n * n;
      }
    const float mean = sum / kCells, variance = (squares - sum * mean) / (kCells - 1);
    all += sum;
    beyond_chance += variance - mean;
    mean_squares += mean * mean;
  }
  return beyond_chance < kUnevenness * mean_squares &&
         all >= kLeastDensity * grid_.area_px(tile) * static_cast<float>(hops());
}

// Each tile has one vote, however many events it has: edges make many, but in few tiles.
std::complex<float> FlickerAnalysis::vote(const Demodulated& z) const {
  std::complex<float> sum = 0;
  for (std::size_t k = 0; k < grid_.tiles; ++k) {
    if (!has_votes(k)) continue;
    const std::complex<float> coherence = (z.halves[0][k] + z.halves[1][k]) / (counts_[0][k] + counts_[1][k]);
    sum += coherence * std::abs(coherence);
  }
  return sum;
}

std::optional<Oscillation> FlickerAnalysis::find() {
  const int n = hops();
  if (n < kLeastHops) return std::nullopt;
  sum_rows();
  std::size_t best = 0;
  std::vector<std::complex<float>> votes;
  Demodulated at_best;
  for (std::size_t i = 0; i < kFrequencies; ++i) {
    Demodulated z = demodulate(std::span(rotations_).subspan(i * kMostColumns, kMostColumns));
    votes.push_back(vote(z));
    if (i > 0 && std::norm(votes[i]) <= std::norm(votes[best])) continue;
    best = i;
    at_best = std::move(z);
  }
  if (votes[best] == 0.0F) return std::nullopt;
  // From half to half the phase advances by what the frequency is wrong.
  std::complex<float> advance = 0;
  for (std::size_t k = 0; k < grid_.tiles; ++k) {
    const std::complex<float> older = at_best.halves[0][k], newer = at_best.halves[1][k];
    if (has_votes(k) && std::real((older + newer) * std::conj(votes[best])) > 0)
      advance += newer * std::conj(older) / (counts_[0][k] * counts_[1][k]);
  }
  const float turn = std::arg(advance);
  const double half_s = static_cast<double>(n) / 2 * kHopRows * static_cast<double>(kRow_ns) / kNsPerS;
  Oscillation out;
  out.frequency_hz = frequency_hz(best) + turn / (2 * std::numbers::pi * half_s);

  float others = 1e-6F;
  for (std::size_t i = 0; i < kFrequencies; ++i)
    if (std::abs(frequency_hz(i) - frequency_hz(best)) >= kLineHz * kMostHops / n)
      others = std::max(others, std::abs(votes[i]));
  // Short pulses of a lower frequency have harmonics.
  for (const int divisor : {2, 3})
    others = std::max(others, std::abs(vote(demodulate(rotations(out.frequency_hz / divisor)))));
  out.prominence = std::abs(votes[best]) / others;
  find_tiles(at_best, votes[best], turn, out);
  return out;
}

// `common`: direction of the phase of all; `turn`: from half to half.
void FlickerAnalysis::find_tiles(const Demodulated& z, std::complex<float> common, float turn,
                                 Oscillation& out) {
  for (std::size_t k = 0; k < grid_.tiles; ++k) {
    found_[k] = Tile::kOther;
    if (!has_votes(k)) continue;
    // Each as if it were at the middle of both.
    const std::complex<float> older = z.halves[0][k] * std::polar(1.0F, turn / 2),
                              newer = z.halves[1][k] * std::polar(1.0F, -turn / 2), both = older + newer;
    const float coherence = std::min(std::abs(older) / counts_[0][k], std::abs(newer) / counts_[1][k]);
    const bool follows =
        coherence > kCoherence &&
        std::real(older * std::conj(newer)) > kSamePhase * std::abs(older) * std::abs(newer) &&
        std::real(both * std::conj(common)) > kSamePhase * std::abs(both) * std::abs(common);
    if (!follows) continue;
    ++out.tiles;
    found_[k] = coherence > kMostCoherence && is_even(k) ? Tile::kEven : Tile::kFollows;
    out.even_tiles += found_[k] == Tile::kEven ? 1 : 0;
  }
}

}  // namespace idol
