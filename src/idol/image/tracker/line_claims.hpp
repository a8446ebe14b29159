// Which line does an event belong to? The lines of a batch claim its events, by where they are predicted.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Events by pixels about an end of a line, from so many px inside to the outermost outside.
constexpr int kEndInside = 4, kEndOutside = 6;
using EndCounts = Eigen::Array<float, kEndInside + kEndOutside, 1>;

/// A line at a batch's middle time, and what the batch's events say of it. Frame: origin (cx, cy), along (dx,
/// dy), across (-dy, dx) [px].
struct ClaimingLine {
  LineId id = kNoLine;
  float cx = 0, cy = 0, dx = 1, dy = 0, lo = 0, hi = 0;
  float rate = 0, turn = 0;  ///< of the offset and the slope [px/s, 1/s]
  float gate = 1.5F;         ///< events nearer are its own [px]
  float expected = 0;        ///< polarity expected: 1, -1, or 0 for any
  float* along = nullptr;    ///< events by pixels along the line, the first at `along_at`: added to
  float along_at = 0;

  /// Of the events near the line and no other: number, sums along it, across it (by prediction) and of times
  /// from the middle, and of the second Legendre polynomial along it, by distance.
  int n = 0;
  float u = 0, uu = 0, r = 0, ur = 0, t = 0, rr = 0, rrrr = 0, bow = 0;
  int core = 0, left = 0, right = 0;  ///< events near it, and farther out to either side
  int contrast = 0;                   ///< events of polarity on less those off
  EndCounts at_lo = EndCounts::Zero(), at_hi = EndCounts::Zero();
  Time last = 0;  ///< newest event claimed
};

class LineClaims {
 public:
  explicit LineClaims(const UndistortMap& undistort);
  /// Labels the events of a batch (time order) with the ids of `lines`, to which it adds what they say; those
  /// without are in rest(). Events of pixels with `isolated` of `hot` or more are left out: returns how
  /// many.
  std::size_t claim(std::span<const Event> events, Time middle, std::span<ClaimingLine> lines,
                    std::span<const std::uint8_t> isolated, std::uint8_t hot, LineId* labels);
  [[nodiscard]] std::span<const std::uint32_t> rest() const { return rest_; }

  static constexpr float kCoreGate = 0.67F;  ///< of the gate: near the line
  static constexpr float kParallel = 0.99F;  ///< cosine between two pieces of one line

 private:
  static constexpr std::size_t kNamed = 3;         // lines that a cell can name
  using Cell = std::array<std::uint16_t, kNamed>;  // index + 1; 0 = none
  struct Pixel {
    float x, y;  // undistorted
    std::uint32_t cell;
  };
  [[nodiscard]] std::size_t pixel_of(const Event& e) const {
    return static_cast<std::size_t>(e.y) * width_ + e.x;
  }
  void draw(std::uint16_t index, const ClaimingLine& line, float band);
  void sort_by_line(std::span<const Event> events, Time middle, std::size_t lines,
                    std::span<const std::uint8_t> isolated, std::uint8_t hot_from);
  ClaimingLine* claim_contested(std::size_t at, const Cell& named, std::span<ClaimingLine> lines) const;

  std::size_t width_;
  std::vector<Pixel> pixels_;
  // The undistorted plane in cells, each naming the lines that pass.
  Eigen::Vector2f low_ = Eigen::Vector2f::Zero();  // corner of the first cell
  int cols_ = 0, rows_ = 0;
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> drawn_;
  // The batch, sorted by the only line near: first events with none, then those of each line, with several,
  // of hot pixels. `starts_` has a place more than there are kinds.
  std::vector<std::uint16_t> kinds_;
  std::vector<std::uint32_t> starts_, next_, order_;
  std::vector<float> x_, y_, t_, polarity_;
  std::vector<std::int32_t> mine_;
  std::vector<std::uint32_t> rest_;
};

}  // namespace idol
