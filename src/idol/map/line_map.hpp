// The lines that were mapped and are no longer in the estimator's problem, found again by where they can be
// seen from.
#pragma once

#include <array>
#include <map>
#include <unordered_map>
#include <vector>

#include "idol/backend/anchored_line.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// A landmark out of the estimator's problem.
struct ArchivedLine {
  LineId id = kNoLine;
  AnchoredLine line;
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();  ///< of the line's coordinates, absolute in the world
  LineEnds ends;                                         ///< of the segment that was seen [m], in the world
  double distance_m = 0;  ///< from the camera to the segment's middle when it was seen last
};

/// Archived lines in hashed grids whose cells are as large as the distance from which a line was seen, one
/// grid for each power of two: a query looks at a fixed number of cells per grid, however many lines there
/// are.
class LineMap {
 public:
  void insert(ArchivedLine line);
  void erase(LineId id);
  [[nodiscard]] const ArchivedLine* find(LineId id) const;
  [[nodiscard]] std::size_t size() const { return lines_.size(); }
  /// Lines whose middle is at most about twice as far from the position as it was when they were seen, by id.
  [[nodiscard]] std::vector<const ArchivedLine*> near(const Vec3& position) const;

 private:
  using Cell = std::array<std::int64_t, 4>;  // level, then x, y, z in cells
  struct Hash {
    std::size_t operator()(const Cell& cell) const;
  };
  [[nodiscard]] static Cell cell_of(const Vec3& position, int level);
  [[nodiscard]] static Cell cell_of(const ArchivedLine& line);

  std::map<LineId, ArchivedLine> lines_;
  std::unordered_map<Cell, std::vector<LineId>, Hash> cells_;
  std::map<int, std::size_t> levels_;  // number of lines in each
};

}  // namespace idol
