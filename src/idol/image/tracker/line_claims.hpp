// Which line does an event belong to? The lines of a batch claim its events, by where they are predicted.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"
#include "idol/base/wide.hpp"

namespace idol {

/// Events by pixels about an end of a line, from so many px inside to the outermost outside.
constexpr int kEndInside = 4, kEndOutside = 6;
using EndCounts = Eigen::Array<float, kEndInside + kEndOutside, 1>;

/// A line at a batch's middle time, and what the batch's events say of it. Frame: origin (cx, cy) in its
/// middle, along (dx, dy), across (-dy, dx) [px].
struct ClaimingLine {
  LineId id = kNoLine;
  float cx = 0, cy = 0, dx = 1, dy = 0;
  float half = 0;            ///< it reaches so far from the origin to either side [px]
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

  /// Lines that pass a cell of the image, as many as have room: index + 1 in 16 bits each, the first lowest,
  /// 0 after the last.
  using Names = std::uint64_t;
  static constexpr int kNameBits = 16, kNamed = 3;
  static constexpr Names kNameMask = (Names{1} << kNameBits) - 1;
  /// What tells where an event is about a line: centre, direction, half length, rate, turn, gate.
  using LineRow = std::array<float, kLanes>;

 private:
  // Names, and above them the batch that they are of: those of an earlier one are void, so that no cell has
  // to be wiped.
  using Cell = std::uint64_t;
  static constexpr float kPerCell = 1.0F / 3;  // [1/px]
  static constexpr int kStampShift = kNameBits * kNamed;
  static constexpr Names kNamesMask = (Names{1} << kStampShift) - 1;
  [[nodiscard]] const Cell& cell_at(const Eigen::Vector2f& px) const {
    const Eigen::Vector2i at = ((px.cwiseMax(low_).cwiseMin(high_) - low_) * kPerCell).cast<int>();
    return cells_[static_cast<std::size_t>(at.y() * cols_ + at.x())];
  }
  [[nodiscard]] Names names_of(Cell cell) const {
    return cell >> kStampShift == batch_ ? cell & kNamesMask : 0;
  }
  void place_lines(std::span<const ClaimingLine> lines, float half_span);
  void draw(Names name, const ClaimingLine& line, float band);

  const UndistortMap* undistort_;
  // The undistorted plane in cells, from low_ to high_ [px].
  Eigen::Vector2f low_ = Eigen::Vector2f::Constant(1e9F), high_ = Eigen::Vector2f::Constant(-1e9F);
  int cols_ = 0, rows_ = 0;
  std::vector<Cell> cells_;
  std::vector<LineRow> line_rows_;  // of the batch, for either polarity
  std::uint64_t batch_ = 0;
  std::vector<std::uint32_t> rest_;
};

}  // namespace idol
