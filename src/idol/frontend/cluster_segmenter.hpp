// The paper's front-end (V): local normals, region growing, links between windows; then the test that a
// cluster is a straight moving line.
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "idol/frontend/segments.hpp"

namespace idol {

class ClusterSegmenter : public Segmenter {
 public:
  ClusterSegmenter(const SegmentOptions& options, const UndistortMap& undistort);
  using Segmenter::process;
  SegmentedWindow process(const EventWindow& window, std::span<const CameraRate> rates) override;
  [[nodiscard]] SegmenterCounts counts() const override { return counts_; }

 private:
  // A line as last seen.
  struct Memory {
    MovingLine line;
    Time window_begin = 0;
    Time last = 0;
  };

  [[nodiscard]] std::optional<Segment> fit_segment(const EventWindow& window,
                                                   std::span<const std::uint32_t> cluster,
                                                   const Eigen::Vector2d& normal) const;
  void link(const EventWindow& window, std::vector<Segment>& segments);
  [[nodiscard]] LineId recall(const EventWindow& window, const Segment& segment) const;
  void remember(const EventWindow& window, const std::vector<Segment>& segments);
  void adapt_scale(double speed_px_s);

  SegmentOptions options_;
  const UndistortMap* undistort_;
  double c_;  // [s/px]
  LineId next_id_ = 0;
  std::vector<LineId> previous_ids_;  // of the previous window's events, the last of which are handed on
  std::map<LineId, Memory> memory_;
  SegmenterCounts counts_;
};

}  // namespace idol
