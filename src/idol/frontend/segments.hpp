// What the front-end makes of a window of events: straight moving lines, and the line of each event.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/options.hpp"
#include "idol/base/types.hpp"
#include "idol/frontend/moving_line.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/image/tracker/line_tracker.hpp"

namespace idol {

/// `paper`: clusters of each window, linked by their common events. `track`: lines followed event by event.
enum class SegmentMethod { kPaper, kTrack };
constexpr std::array<std::string_view, 2> kSegmentMethodNames{"paper", "track"};
constexpr std::span<const std::string_view> option_names(SegmentMethod) { return kSegmentMethodNames; }

struct SegmentOptions {
  SegmentMethod method = SegmentMethod::kTrack;
  TrackOptions track;
  double radius_px = 3.0;
  double c_s_per_px = 0;
  int min_neighbours = 8;
  double min_planarity = 0.5;
  double normal_threshold = 0.95;
  int regrow_rounds = 2;
  double distance_threshold_px = 1.0;
  bool same_polarity = false;
  int min_events = 40;
  double min_length_px = 10;
  double gate_px = 2.0;
  double max_rms_px = 1;
  double max_bow_px = 0.8;
  double max_wave_px = 0.12;
  double wave_share = 0.15;
  double min_inliers = 0.7;
  double memory_s = 0.15;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("method", self.method, Range{},
          "paper: clusters window by window (paper V); track: live lines claim events, fast and with long "
          "tracks");
    visit("track", self.track, Range{}, "");
    visit("radius_px", self.radius_px, Range{1, 10}, "neighbourhood in (x, y, t/c) (paper V)");
    visit("c_s_per_px", self.c_s_per_px, Range{0, 1},
          "time that counts as one pixel, c in the paper (V) [s/px]; 0: from the image speed measured in the "
          "window before");
    visit("min_neighbours", self.min_neighbours, Range{3, 1000},
          "events needed for a normal, the event itself included");
    visit("min_planarity", self.min_planarity, Range{0, 1},
          "1 - smallest/middle eigenvalue below this: no normal");
    visit("normal_threshold", self.normal_threshold, Range{0, 1},
          "n_thr: cosine between normals of one line (paper V)");
    visit("regrow_rounds", self.regrow_rounds, Range{0, 5},
          "times a cluster that is not straight is grown again with (1 - n_thr) / 3; 0: refuse it");
    visit("distance_threshold_px", self.distance_threshold_px, Range{0.1, 10},
          "e_thr: distance of an event from its neighbour's line (paper V) [px]");
    visit("same_polarity", self.same_polarity, Range{},
          "grow segments of one polarity only (the paper ignores polarity)");
    visit("min_events", self.min_events, Range{8, 1e6}, "events needed for a segment");
    visit("min_length_px", self.min_length_px, Range{2, 1000}, "shortest segment [px]");
    visit("gate_px", self.gate_px, Range{0.1, 10},
          "events farther from the segment's fitted line are not of it [px]");
    visit("max_rms_px", self.max_rms_px, Range{0.1, 10}, "a segment that spreads more is not a line [px]");
    visit("max_bow_px", self.max_bow_px, Range{0.1, 10}, "a cluster that bends more is not a line [px]");
    visit(
        "max_wave_px", self.max_wave_px, Range{0.01, 100},
        "a segment whose events waver more about its line is doubtful: the estimator uses it, but its events "
        "get no label (track) [px]");
    visit("wave_share", self.wave_share, Range{0, 10},
          "by so much of its events' scatter across it more (track)");
    visit("min_inliers", self.min_inliers, Range{0, 1},
          "share of a cluster's events that must lie on the line");
    visit("memory_s", self.memory_s, Range{0, 10},
          "a segment without links takes the id of a recent line that would now lie here; 0: links only (the "
          "paper) [s]");
  }
};

/// Events of one line in one window.
struct Segment {
  LineId id = kNoLine;                ///< unique over the recording; kept from window to window
  std::vector<std::uint32_t> events;  ///< indices into the window's events, in time order
  MovingLine line;                    ///< its fitted line, time in s since the window's begin
  bool straight = true;               ///< false: likely texture that is nearly straight
  double sigma_px = 0.6;              ///< scatter of its events across it
  double waviness_px = 0;
};

struct SegmentedWindow {
  /// One an event of the window (overlap included): of its segment, if that is clear; kNoLine = none.
  std::vector<LineId> ids;
  std::vector<Segment> segments;
  /// Of lines that have hardly moved yet: they may turn out to be none. If they are, their next segment is
  /// among `segments`.
  std::vector<Segment> candidates;
  /// Tracks that have turned out to be lines in this window: the id they had among the candidates, and
  /// the one they have from now on.
  std::vector<std::pair<LineId, LineId>> validated;
  double c_s_per_px = 0;  ///< temporal scale used
  double speed_px_s = 0;  ///< median image speed along the normals
};

/// What became of the events so far.
struct SegmenterCounts {
  std::int64_t events = 0, in_segments = 0;
  std::int64_t flicker = 0;      ///< of a flickering lamp: left out before all else
  std::int64_t hot = 0;          ///< of pixels that fire without cause
  std::int64_t unsupported = 0;  ///< of no line and without neighbours: noise
  std::int64_t thinned = 0;      ///< not looked at for new lines, to keep up with the sensor

  /// One more window, its repeated events left out.
  void add(const EventWindow& window, std::span<const LineId> ids);
};

/// What the stages from candidates to reported segments let through so far, and the edges that were followed.
struct StageCounts {
  TrackerCounts tracker;
  std::int64_t few_events = 0;    ///< segments of windows: too few events
  std::int64_t not_straight = 0;  ///< no straight line fits their events
  std::int64_t wavy = 0;          ///< their events waver about the line: no labels
  std::int64_t candidates = 0;    ///< of tracks that were not validated yet
  std::int64_t reported = 0;
  double sigma_px = 0, speed_px_s = 0;  ///< means over the tracks followed

  /// Which test refused most, and what the edges are like, in one clause.
  [[nodiscard]] std::string explanation() const;
};

/// Those of `rates` (in time order) that lie in the window.
std::span<const CameraRate> rates_over(std::span<const CameraRate> rates, const EventWindow& window);

/// Turns windows into segments, one after the other.
class Segmenter {
 public:
  virtual ~Segmenter() = default;
  /// `rates`: the camera's angular rates over the window, in time order, if known: lines then follow its
  /// turns at once. Empty: unknown.
  virtual SegmentedWindow process(const EventWindow& window, std::span<const CameraRate> rates) = 0;
  SegmentedWindow process(const EventWindow& window) { return process(window, {}); }
  /// Does what can be done already of a window that is still open and comes to process() next, with more
  /// events at its end and the same rates as far as they are given. Changes no result, only when it is ready.
  virtual void prepare(const EventWindow& /*window*/, std::span<const CameraRate> /*rates*/) {}
  [[nodiscard]] virtual SegmenterCounts counts() const = 0;
  /// nullopt for a segmenter that has no such stages.
  [[nodiscard]] virtual std::optional<StageCounts> stages() const { return std::nullopt; }
};

/// The segmenter of `options.method`. `undistort` must outlive it.
std::unique_ptr<Segmenter> make_segmenter(const SegmentOptions& options, const UndistortMap& undistort);

}  // namespace idol
