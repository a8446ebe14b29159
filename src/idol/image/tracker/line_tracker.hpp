// Live lines followed event by event: predicted lines claim events, claimed events correct the lines, the
// rest feeds the detector. No windows, no neighbour lists; the result does not depend on how events are
// spread over calls.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/base/options.hpp"
#include "idol/base/types.hpp"
#include "idol/image/tracker/line_claims.hpp"
#include "idol/image/tracker/line_detector.hpp"

namespace idol {

struct TrackOptions {
  double batch_s = 0.004;
  int batch_events = 4000;
  double min_length_px = 8;
  double max_bow_px = 0.8;
  double max_quiet_s = 0.3;
  int max_lines = 200;
  double detect_rate = 3e5;

  template <class Self, class Visitor>
  static void fields(Self& self, Visitor&& visit) {
    visit("batch_s", self.batch_s, Range{1e-4, 0.1}, "lines are corrected this often [s]");
    visit("batch_events", self.batch_events, Range{10, 1e6}, "and after this many events");
    visit("min_length_px", self.min_length_px, Range{4, 1000}, "shortest line [px]");
    visit("max_bow_px", self.max_bow_px, Range{0.1, 10}, "a track that bends more is not a line [px]");
    visit("max_quiet_s", self.max_quiet_s, Range{0.01, 10},
          "a track without events for this long is dropped [s]");
    visit("detect_rate", self.detect_rate, Range{1e3, 1e9},
          "events a second that are looked at for new lines; more are thinned evenly [1/s]");
    visit("max_lines", self.max_lines, Range{1, 4000}, "tracks at a time");
  }
};

/// A line as it is followed. Frame: origin `centre`, along `dir`, across `normal` = dir turned by +90
/// degrees.
struct LineTrack {
  LineId id = kNoLine;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero(), dir = Eigen::Vector2d::UnitX();
  Eigen::Vector2d normal = Eigen::Vector2d::UnitY();
  double lo = 0, hi = 0;                        ///< extent along dir [px]
  Eigen::Vector4d x = Eigen::Vector4d::Zero();  ///< offset, slope and their rates [px, 1, px/s, 1/s]
  Eigen::Matrix4d P = Eigen::Matrix4d::Identity();
  Time time = 0;  ///< of the state
  Time born = 0, last_event = 0;
  double sigma = 0.6;  ///< scatter of its events across it [px]
  bool validated = false;
  bool alive = true;
  bool refused = false;               ///< ended young, as none
  double travel = 0;                  ///< motion since birth [px]
  double fresh_travel = 0;            ///< since the last look at the statistics [px]
  double support = 0, by_chance = 0;  ///< events claimed since birth, and those of noise among them
  double core = 0, left = 0, right = 0, contrast = 0, bow = 0, bow_n = 0, spread = 0, fourth = 0,
         noise = 0;  ///< fading sums over claimed events, and those expected by chance inside the gate
  /// Of near events that have not corrected the state yet: number, sums along the line, across it, and of
  /// times from the state's on; and how many of them noise gives.
  struct Waiting {
    double n = 0, u = 0, uu = 0, r = 0, ur = 0, t = 0, noise = 0;
  } waiting;
  /// Claimed events about the ends; fading like `all`.
  EndCounts at_lo = EndCounts::Zero(), at_hi = EndCounts::Zero();
  double all = 0, unlooked = 0;
  /// Claimed events by pixels along the line, the first at `along_at`; fading slowly. A gap in them parts the
  /// line in two.
  std::vector<float> along;
  double along_at = 0;
};

/// Why a track ended.
enum class EndReason {
  kQuiet,   ///< no events of its own for long
  kFast,    ///< faster than any edge
  kBrief,   ///< too short, or hardly longer than wide
  kSparse,  ///< too few events for its motion
  kBeside,  ///< as many events to both sides as on it: texture
  kBent,
  kWide,    ///< its events fill the gate evenly
  kDouble,  ///< two edges, not one
  kNoise,   ///< no more events than noise
  kUneven,  ///< events in few places along it: it lies across other lines
};
constexpr std::array<std::string_view, 10> kEndReasonNames{"quiet", "fast", "brief",  "sparse", "beside",
                                                           "bent",  "wide", "double", "noise",  "uneven"};

/// What the stages from a candidate to a line let through so far.
struct TrackerCounts {
  DetectorCounts detector;
  std::int64_t born = 0, validated = 0;
  std::array<std::int64_t, kEndReasonNames.size()> ended{};
};

class LineTracker {
 public:
  LineTracker(const TrackOptions& options, const UndistortMap& undistort);

  /// How many of `events` make the next batch: batches tile the time from `origin` on, and end early when
  /// full.
  [[nodiscard]] std::size_t batch_length(std::span<const Event> events, Time origin) const;
  /// Labels a batch of events (time order, all inside one batch); -1 = none. Ids of candidates count
  /// too.
  void process(std::span<const Event> events, LineId* labels);

  [[nodiscard]] const std::vector<LineTrack>& tracks() const { return tracks_; }
  /// The camera's angular rate from that time on, in its own frame [rad/s]: the lines' rates follow its
  /// change.
  void turn(Time from, const Vec3& omega);
  /// Forgets dead tracks without events from `t` on; their ids must not be asked for any more.
  void forget_before(Time t);

  /// Whether it may still be asked for.
  [[nodiscard]] bool knows(LineId id) const { return known_.contains(id); }
  /// True if the track was ever validated.
  [[nodiscard]] bool validated(LineId id) const { return known_.at(id).validated; }
  /// Id that a track was merged into, or its own.
  [[nodiscard]] LineId final_id(LineId id) const;
  /// Normal of a track, dead or alive, as last seen.
  [[nodiscard]] const Eigen::Vector2d& normal(LineId id) const { return known_.at(id).normal; }
  /// A track as it is followed, if it is alive.
  [[nodiscard]] const LineTrack* find(LineId id) const {
    const auto it =
        std::find_if(tracks_.begin(), tracks_.end(), [&](const LineTrack& t) { return t.id == id; });
    return it == tracks_.end() ? nullptr : &*it;
  }
  /// Tracks that have been validated since the last call: their id until then, and from then on.
  [[nodiscard]] std::vector<std::pair<LineId, LineId>> take_validated() {
    return std::exchange(newly_validated_, {});
  }
  /// Events so far: of hot pixels, without a line and without support, left out of the search for new lines.
  [[nodiscard]] std::int64_t hot() const { return hot_; }
  [[nodiscard]] std::int64_t unsupported() const { return unsupported_; }
  [[nodiscard]] std::int64_t thinned() const { return detector_.skipped(); }
  [[nodiscard]] TrackerCounts counts() const {
    TrackerCounts out = counts_;
    out.detector = detector_.counts();
    return out;
  }
  [[nodiscard]] Time born(LineId id) const { return known_.at(id).born; }
  /// Polarity that its events have by its motion at the time: 1, -1, or 0 where that is not known.
  [[nodiscard]] float polarity(LineId id) const { return known_.at(id).polarity; }
  [[nodiscard]] double sigma_px(LineId id) const { return known_.at(id).sigma; }
  [[nodiscard]] double c_s_per_px() const { return c_; }
  [[nodiscard]] const TrackOptions& options() const { return options_; }

 private:
  [[nodiscard]] std::uint8_t hot_from() const;
  [[nodiscard]] static double gate(const LineTrack& track);
  void predict(LineTrack& track, Time t) const;
  void advance(LineTrack& track, Time t) const;
  [[nodiscard]] static ClaimingLine claiming(LineTrack& track);
  void correct(LineTrack& track, const ClaimingLine& sums, double noise, double duration);
  void assess(LineTrack& track, Time now);
  void end(LineTrack& track, EndReason reason);
  [[nodiscard]] static float expected_polarity(const LineTrack& track);
  void split(LineTrack& track, Time now);
  void promote(LineTrack& track, Time now);
  static double evenness(const LineTrack& track);
  static double move_end(EndCounts& counts, float density);
  void search(std::span<const Event> events, double duration);
  bool support_of(const Event& event, std::uint32_t us, std::uint32_t within);
  void seed(const LineSeed& seed);
  void propagate_lost(Time now);
  void merge_lines(Time now);
  void adapt_scale();
  void fit_flow();
  /// Image velocity there, by the motion of all lines [px/s].
  [[nodiscard]] Eigen::Vector2d flow(const Eigen::Vector2d& px) const;

  static constexpr double kGateSigmas = 2;        // standard deviations across a line that are its own
  static constexpr double kFastestScale = 0.001;  // [s/px]
  static constexpr double kMinDensity = 0.05;     // events per px of line and px of motion

  TrackOptions options_;
  const UndistortMap* undistort_;
  LineClaims claims_;
  LineDetector detector_;
  std::vector<LineTrack> tracks_;
  std::vector<ClaimingLine> lines_;   // the tracks, for the batch at hand
  std::vector<LineTrack> split_off_;  // pieces that the batch at hand has cut off
  std::vector<LineTrack>
      lost_;  // validated ones that ended of late, moved on: a new one there goes on as them
  // What is still asked of a track after its end.
  struct Known {
    LineId merged_into = kNoLine;
    bool validated = false;
    Eigen::Vector2d normal = Eigen::Vector2d::UnitY();
    Time last_event = 0;
    double sigma = 0.6;
    Time born = 0;
    float polarity = 0;
  };
  std::unordered_map<LineId, Known> known_;
  LineId next_id_ = 0;
  std::optional<Vec3> omega_;  // [rad/s]
  double c_ = 0.01;
  double usual_speed_ = 100;  // of lines that move [px/s]
  // Affine image flow: of (1, x, y) from the image's middle in units of half its width [px/s].
  Eigen::Matrix<double, 2, 3> flow_ = Eigen::Matrix<double, 2, 3>::Zero();
  Time next_merge_ = 0;
  std::vector<std::uint8_t> isolated_;  // events without a neighbour's support, fading: many of a hot pixel
  std::vector<std::uint32_t> last_[2];  // event of a pixel and polarity [us]
  std::vector<std::array<std::uint32_t, 4>> recent_[2];  // of a cell of 4 x 4 pixels and polarity [us]
  std::vector<std::uint8_t> turn_[2];                    // where its next goes
  int recent_cols_ = 0;
  Time next_fade_ = 0, last_batch_ = 0;
  std::vector<std::pair<LineId, LineId>> newly_validated_;
  std::int64_t hot_ = 0, unsupported_ = 0;
  TrackerCounts counts_;
  // Events of noise [1/(px s)]. From above: an estimate that is too low takes noise for neighbours and stays.
  double background_ = 30;
  double noise_known_s_ = 0;
};

}  // namespace idol
