// Segments from lines that are followed event by event.
#pragma once

#include <optional>
#include <unordered_map>
#include <vector>

#include "idol/frontend/segments.hpp"
#include "idol/image/tracker/line_tracker.hpp"
#include "idol/image/tracker/waviness.hpp"

namespace idol {

/// Events of a window as columns: undistorted [px], time since its begin [s].
struct WindowColumns {
  std::vector<float> x, y, t;
  bool filled = false;
  void fill(const EventWindow& window, const UndistortMap& undistort);
};

class TrackSegmenter : public Segmenter {
 public:
  TrackSegmenter(const SegmentOptions& options, const UndistortMap& undistort)
      : options_(options), undistort_(&undistort), tracker_(options.track, undistort) {}
  using Segmenter::process;
  SegmentedWindow process(const EventWindow& window, std::span<const CameraRate> rates) override;
  void prepare(const EventWindow& window, std::span<const CameraRate> rates) override;
  [[nodiscard]] SegmenterCounts counts() const override;
  [[nodiscard]] std::optional<StageCounts> stages() const override;

 private:
  void label(const EventWindow& window, std::span<const CameraRate> rates, bool open);
  void sort_by_track(SegmentedWindow& out) const;
  void label_back(const EventWindow& window, Segment& segment, bool labelled, std::vector<LineId>& ids);
  [[nodiscard]] std::optional<MovingLine> track_line(const EventWindow& window, LineId id) const;
  [[nodiscard]] std::optional<MovingLine> fit_track(const EventWindow& window,
                                                    std::span<const std::uint32_t> events, LineId id);

  SegmentOptions options_;
  const UndistortMap* undistort_;
  LineTracker tracker_;
  std::vector<LineId> previous_ids_;  // of the previous window's events, the last of which are handed on
  std::vector<LineId> ids_;           // of the window at hand
  std::optional<Time> at_hand_;       // its begin, once its first events are labelled
  std::size_t labelled_ = 0;          // how many are
  std::unordered_map<LineId, Waviness> waviness_;
  std::vector<TimedPixel> points_;  // scratch
  WindowColumns columns_;           // scratch
  std::vector<std::uint8_t> near_;  // scratch
  SegmenterCounts counts_;
  StageCounts stages_;
  double followed_ = 0;  // tracks by windows, of which the means are
};

}  // namespace idol
