// Finds flicker in the recent past: its frequency, where it is, and how its events are spread over its
// period.
#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "idol/base/types.hpp"

namespace idol {

/// The image in square tiles of 16 px or a larger power of two, 24 at most across it, each of 4 x 4 cells. A
/// channel is a tile and a polarity.
struct TileGrid {
  static constexpr int kCellsShift = 2;

  TileGrid(int width, int height);
  [[nodiscard]] std::size_t channel(const Event& e) const {
    return static_cast<std::size_t>(e.y >> shift) * nx + static_cast<std::size_t>(e.x >> shift) +
           (e.polarity ? tiles : 0);
  }
  [[nodiscard]] std::size_t channels() const { return 2 * tiles; }
  [[nodiscard]] std::size_t cell(const Event& e) const {
    const int cell_shift = shift - kCellsShift;
    return static_cast<std::size_t>(e.y >> cell_shift) * (nx << kCellsShift) +
           static_cast<std::size_t>(e.x >> cell_shift);
  }
  [[nodiscard]] std::size_t cells() const { return tiles << 2 * kCellsShift; }
  /// Pixels of a tile that are in the image.
  [[nodiscard]] float area_px(std::size_t tile) const;

  int width = 0, height = 0, shift = 4;
  std::size_t nx = 0, ny = 0, tiles = 0;
};

/// The strongest oscillation of ON against OFF events between 70 and 150 Hz, flicker or not.
struct Oscillation {
  double frequency_hz = 0;
  float prominence =
      0;          ///< how many times as strong as any other frequency's, or that of half or a third of it
  int tiles = 0;  ///< in which many events follow it, with one phase
  int even_tiles = 0;  ///< those of them where most do, all over the tile at any time
};

/// Counts of the last 0.16 s: events by row (of 0.25 ms) and channel, and by hop (of 20 ms) and cell.
class FlickerAnalysis {
 public:
  static constexpr Time kRow_ns = 250'000;
  static constexpr int kHopRows = 80, kLeastHops = 4, kMostHops = 8;
  static constexpr int kPhases = 32;  // parts of a period
  using Profile = std::array<float, kPhases>;

  explicit FlickerAnalysis(const TileGrid& grid);

  /// Begins the next row or hop, whose counts are returned; they are zero.
  std::uint16_t* next_row();
  std::uint32_t* next_hop();
  void clear();
  /// To be called at the end of a hop, before the next row begins. nullopt: no events, or fewer than four
  /// hops.
  [[nodiscard]] std::optional<Oscillation> find();
  /// Tells flicker of that frequency from other events, by their phase. `phase` in [0, 1): now, at the end of
  /// a hop.
  void separate(double hz, double phase);
  /// Expected events a period: of flicker, by phase, and the others.
  [[nodiscard]] const Profile& flicker(std::size_t channel) const { return flicker_[channel]; }
  /// Where the phases begin at which flicker of a polarity (1: ON) is least; they are three eighths of all.
  [[nodiscard]] int quiet_phase(std::size_t polarity) const { return quiet_phases_[polarity]; }
  /// True if hardly any events but those of flicker come from there.
  [[nodiscard]] bool only_flicker(std::size_t tile) const { return found_[tile] == Tile::kEven; }
  [[nodiscard]] float others(std::size_t channel) const { return others_[channel]; }

 private:
  using Column = std::vector<float>;  // by tile or channel
  // Of the older and the newer half of the time looked at, by tile.
  struct Demodulated {
    std::array<std::vector<std::complex<float>>, 2> halves;
  };

  [[nodiscard]] static std::vector<std::complex<float>> rotations(double hz);
  [[nodiscard]] int hops() const;
  [[nodiscard]] const std::uint16_t* row(int age) const;
  [[nodiscard]] bool has_votes(std::size_t tile) const;
  void sum_rows();
  [[nodiscard]] Demodulated demodulate(std::span<const std::complex<float>> rotations) const;
  [[nodiscard]] std::complex<float> vote(const Demodulated& z) const;
  [[nodiscard]] bool is_even(std::size_t tile) const;
  void find_tiles(const Demodulated& z, std::complex<float> common, float turn, Oscillation& out);
  [[nodiscard]] float fold(double hz, double phase);
  [[nodiscard]] Profile shape(std::size_t polarity);
  [[nodiscard]] float amount_about(std::size_t channel) const;

  // A column of the signal is 1 ms long.
  static constexpr int kHistory = 1024, kDecimation = 4;
  static constexpr int kMostColumns = kMostHops * kHopRows / kDecimation;

  TileGrid grid_;
  std::vector<std::uint16_t> history_;  // [kHistory][channels]
  std::vector<std::uint32_t> cells_;    // [kMostHops][cells]
  int newest_row_ = 0, rows_ = 0, newest_hop_ = 0;
  std::size_t stride_;  // of the signal: tiles, and some more to be a multiple of the lanes
  Column signal_;       // ON less OFF events, [kMostColumns][stride_], oldest first
  std::vector<std::complex<float>> rotations_;  // [frequency][kMostColumns]
  std::array<Column, 2> counts_;                // events by tile, of the older and the newer half
  enum class Tile : std::uint8_t { kOther, kFollows, kEven };
  std::vector<Tile> found_;
  std::array<int, 2> quiet_phases_{};
  std::vector<Profile> folded_, flicker_;
  Column totals_, amounts_, errors_, others_;  // by channel
};

}  // namespace idol
