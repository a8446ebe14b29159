// New lines from the events that no live line claims. Events are kept in cells of the image; where enough new
// ones have come, a straight moving line is fitted to those of the cell and its neighbours, whatever its
// width and speed.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// What detector and tracker take an edge for [px].
struct EdgeLimits {
  static constexpr double kLeastGate = 1.3, kMostGate = 4.5;  ///< events this near are its own
  static constexpr double kMostSigma = 2.6;                   ///< scatter of its events across it
};

/// A straight piece of a moving line found, at the time of its newest event.
struct LineSeed {
  Time time = 0;
  Eigen::Vector2d centre, normal;  ///< [px], unit
  double speed = 0;                ///< along the normal [px/s]
  double speed_sigma = 0;          ///< standard deviation of it [px/s]
  double sigma = 0;                ///< scatter of its events across it [px]
  double length = 0;               ///< [px]
  bool polarity = false;           ///< of its events
};

/// The fits that the detector has tried, and why most of them are no lines.
struct DetectorCounts {
  std::int64_t fits = 0;
  std::int64_t few = 0;      ///< too few events on one line, or no more than noise makes by chance
  std::int64_t wide = 0;     ///< an edge too wide
  std::int64_t texture = 0;  ///< as many events beside the line as on it
  std::int64_t bent = 0;
  std::int64_t brief = 0;  ///< too short
  std::int64_t seeds = 0;  ///< lines
};

class LineDetector {
 public:
  explicit LineDetector(const UndistortMap& undistort);
  /// Before each batch: how many events of it may be taken (when the batch before had more, only every
  /// second, third, ... one is), the shortest line [px], and the rate of noise [1/(px^2 s)].
  void begin_batch(Time begin, double most, double min_length, double noise);
  /// Events that were left out for this, by now.
  [[nodiscard]] std::int64_t skipped() const { return skipped_; }
  [[nodiscard]] const DetectorCounts& counts() const { return counts_; }
  /// Takes an unclaimed event.
  void add(const Event& event);
  /// About there a line was found that was none: for a while, more events are needed for the next.
  void discourage(const Eigen::Vector2d& px);
  /// What the batch's events completed, until the next batch.
  [[nodiscard]] std::span<const LineSeed> end_batch() const { return seeds_; }

  /// A moving line: n . x = d + v t, relative to the place and time of the newest event.
  struct MovedLine {
    float nx = 1, ny = 0, d = 0, v = 0;
    float sigma = 0;      ///< standard deviation of its events across it [px]
    float n = 0, tt = 0;  ///< events, and their variance in time [s^2]
  };

 private:
  static constexpr int kCell = 8;   // [px]
  static constexpr int kKept = 64;  // events of a cell and polarity
  struct Point {
    float x, y;  // undistorted [px]
    std::uint32_t us;
  };
  struct Cell {
    std::array<Point, kKept> points;
    std::uint32_t count = 0;   // of all that came
    std::uint32_t tested = 0;  // count at the last test
    std::uint32_t wanted = 0;  // new ones before the next
    [[nodiscard]] std::uint32_t held() const { return count < kKept ? count : kKept; }
  };
  // Events of a cell and its neighbours relative to the place and time of the newest [px, s], the cell's own
  // first.
  struct Columns;
  // A line's piece that its events fill.
  struct Profile {
    float middle = 0, length = 0;    // along the line [px]
    int on = 0, beside = 0;          // events; twice those on the emptier side
    float bend = 0, bend_sigma = 0;  // offset of its middle third from its outer ones [px]
  };

  void gather(int col, int row, int polarity, std::uint32_t now, Columns& out) const;
  [[nodiscard]] static MovedLine fit(const Columns& columns);
  [[nodiscard]] static Profile profile(const Columns& columns, const MovedLine& line);
  [[nodiscard]] bool is_line(const MovedLine& line, const Profile& profile);
  bool test(int col, int row, int polarity, const Event& newest);
  static void remove(Cell& cell, const MovedLine& line, const Point& origin, std::uint32_t now);
  [[nodiscard]] Cell& cell(int col, int row, int polarity) {
    return cells_[static_cast<std::size_t>(polarity)][static_cast<std::size_t>(row * cols_ + col)];
  }
  [[nodiscard]] const Cell& cell(int col, int row, int polarity) const {
    return cells_[static_cast<std::size_t>(polarity)][static_cast<std::size_t>(row * cols_ + col)];
  }

  const UndistortMap* undistort_;
  int cols_, rows_;
  std::array<std::vector<Cell>, 2> cells_;
  Time next_fade_ = 0;
  std::int64_t candidates_ = 0, stride_ = 1;  // of this batch; of how many candidates one is taken
  std::int64_t skipped_ = 0;
  double min_length_ = 0, noise_ = 0;
  DetectorCounts counts_;
  std::vector<LineSeed> seeds_;
};

}  // namespace idol
