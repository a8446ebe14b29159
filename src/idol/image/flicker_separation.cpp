// How flicker of a known frequency is told from other events: by their phase.
#include <algorithm>
#include <cmath>
#include <limits>

#include "idol/base/wide.hpp"
#include "idol/image/flicker_analysis.hpp"

namespace idol {
namespace {

constexpr float kSigmas = 4;           // by which a tile's flicker exceeds chance
constexpr float kLeastShare = 0.005F;  // of the peak: less is no part of the period
constexpr float kScatters = 3;  // nor is what exceeds the quiet phases by less than so many of their own
constexpr int kLeastEven = 4;   // tiles that tell the shape of a period
constexpr float kUnlikeOthers = 1.5F;  // as much flicker as the tiles about it a tile may have

IDOL_WIDE void add_shared(const std::uint16_t* counts, float share_a, float share_b, float* a, float* b,
                          std::size_t n) {
  for (std::size_t k = 0; k < n; ++k) {
    const auto count = static_cast<float>(counts[k]);
    a[k] += share_a * count;
    b[k] += share_b * count;
  }
}

}  // namespace

// Events a period by phase; returns the number of periods that they are from, which is a whole one.
float FlickerAnalysis::fold(double hz, double phase) {
  const std::size_t channels = grid_.channels();
  const double period_rows = kNsPerS / hz / static_cast<double>(kRow_ns);
  const double periods = std::floor(hops() * kHopRows / period_rows);
  Column sums(kPhases * channels);
  for (int age = 0; age + 0.5 < periods * period_rows; ++age) {
    // A row counts for the two phases next to its middle: so all phases get the same time.
    const double turns = phase - (age + 0.5) / period_rows;
    const double at = (turns - std::floor(turns)) * kPhases + kPhases - 0.5;
    const auto left = static_cast<std::size_t>(at);
    const auto share = static_cast<float>(at - std::floor(at));
    add_shared(row(age), 1 - share, share, &sums[left % kPhases * channels],
               &sums[(left + 1) % kPhases * channels], channels);
  }
  for (std::size_t c = 0; c < channels; ++c) {
    totals_[c] = 0;
    for (std::size_t b = 0; b < kPhases; ++b) {
      folded_[c][b] = sums[b * channels + c] / static_cast<float>(periods);
      totals_[c] += folded_[c][b];
    }
  }
  return static_cast<float>(periods);
}

// How the flicker's events of a polarity are spread over the period; sums to 1. From tiles that hardly have
// other events, if there are some. The quietest three eighths of the period on end have no flicker.
FlickerAnalysis::Profile FlickerAnalysis::shape(std::size_t polarity) {
  constexpr std::size_t kQuiet = kPhases * 3 / 8;
  const auto even = std::count(found_.begin(), found_.end(), Tile::kEven);
  const Tile wanted = even >= kLeastEven ? Tile::kEven : Tile::kFollows;
  Profile out{};
  for (std::size_t k = 0; k < grid_.tiles; ++k) {
    const std::size_t c = k + polarity * grid_.tiles;
    if (found_[k] < wanted || totals_[c] <= 0) continue;
    for (std::size_t b = 0; b < kPhases; ++b) out[b] += folded_[c][b] / totals_[c];
  }
  float least = std::numeric_limits<float>::max(), scatter = 0;
  for (std::size_t first = 0; first < kPhases; ++first) {
    float sum = 0, squares = 0;
    for (std::size_t b = 0; b < kQuiet; ++b) {
      const float value = out[(first + b) % kPhases];
      sum += value;
      squares += value * value;
    }
    if (sum >= least * kQuiet) continue;
    least = sum / kQuiet;
    quiet_phases_[polarity] = static_cast<int>(first);
    scatter = std::sqrt(std::max(0.0F, squares / kQuiet - least * least));
  }
  const float peak = *std::max_element(out.begin(), out.end()) - least;
  const float negligible = std::max(kLeastShare * peak, kScatters * scatter);
  float sum = 0;
  for (float& share : out) {
    share = share - least > negligible ? share - least : 0;
    sum += share;
  }
  for (float& share : out) share = sum > 0 ? share / sum : 1.0F / kPhases;
  return out;
}

// Median of the amounts a pixel in the tiles about.
float FlickerAnalysis::amount_about(std::size_t channel) const {
  constexpr std::size_t kReach = 2;
  const std::size_t tile = channel % grid_.tiles, first = channel - tile;
  const std::size_t x = tile % grid_.nx, y = tile / grid_.nx;
  std::array<float, (2 * kReach + 1) * (2 * kReach + 1)> values{};
  std::size_t n = 0;
  for (std::size_t v = y - std::min(y, kReach); v <= std::min(y + kReach, grid_.ny - 1); ++v)
    for (std::size_t u = x - std::min(x, kReach); u <= std::min(x + kReach, grid_.nx - 1); ++u) {
      const std::size_t k = v * grid_.nx + u;
      const float amount = amounts_[first + k];
      values[n++] = amount < errors_[first + k] ? 0 : amount / grid_.area_px(k);
    }
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n / 2),
                   values.begin() + static_cast<std::ptrdiff_t>(n));
  return values[n / 2];
}

// How much flicker there is in a tile is fitted to its events by least squares. An edge that crosses the
// pixels at nearly the flicker's rhythm looks like flicker, and one that makes many events hides it, but not
// in most tiles about.
void FlickerAnalysis::separate(double hz, double phase) {
  const float periods = fold(hz, phase);
  for (std::size_t polarity = 0; polarity < 2; ++polarity) {
    const Profile form = shape(polarity);
    const std::size_t first = polarity * grid_.tiles;
    float squares = 1e-9F;
    for (const float share : form) squares += (share - 1.0F / kPhases) * (share - 1.0F / kPhases);
    const auto free = static_cast<float>(std::count(form.begin(), form.end(), 0.0F));
    for (std::size_t c = first; c < first + grid_.tiles; ++c) {
      float product = 0, noise = 0, at_free = 0;
      for (std::size_t b = 0; b < kPhases; ++b) {
        const float d = form[b] - 1.0F / kPhases;
        product += d * folded_[c][b];
        noise += d * d * folded_[c][b];
        at_free += form[b] == 0 ? folded_[c][b] : 0;
      }
      amounts_[c] = product / squares;
      errors_[c] = kSigmas * std::sqrt(noise / periods) / squares;
      others_[c] = free > 0 ? at_free * kPhases / free : 0;
    }
    for (std::size_t c = first; c < first + grid_.tiles; ++c) {
      const float about = std::max(0.0F, amount_about(c) * grid_.area_px(c - first));
      float amount = std::min(amounts_[c], kUnlikeOthers * about);
      if (amounts_[c] < errors_[c]) amount = amounts_[c] > about - errors_[c] ? about : 0;
      for (std::size_t b = 0; b < kPhases; ++b) flicker_[c][b] = amount * form[b];
    }
  }
}

}  // namespace idol
