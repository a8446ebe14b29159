// The real-time estimator: states of the last second, minimal lines, compressed events, and everything older
// in a marginal prior (docs/backend.md). Lines out of sight stay in the prior and are found again.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "idol/backend/anchored_line.hpp"
#include "idol/backend/backend.hpp"
#include "idol/backend/backend_options.hpp"
#include "idol/backend/chain_system.hpp"
#include "idol/estimation/imu_intrinsics.hpp"
#include "idol/estimation/marginal_prior.hpp"
#include "idol/map/associate.hpp"
#include "idol/map/line_map.hpp"

namespace idol {

class FixedLag : public Backend {
 public:
  FixedLag(const Rig& rig, const BackendOptions& options);

  void start(const NavState& first, bool still) override;
  void add(WindowMeasurement window) override;
  SolveStats solve() override;
  /// A last pass over everything seen since the last restart, if that is not too long for it.
  SolveStats finish() override;
  [[nodiscard]] std::vector<Line> lines() const override;
  [[nodiscard]] std::size_t line_count() const override;
  [[nodiscard]] std::optional<StateMat> covariance() const override { return covariance_; }
  /// What the marginalised windows know.
  [[nodiscard]] const MarginalPrior& prior() const { return prior_; }
  /// Of a line that is or was in the problem, as estimated. Throws std::out_of_range for others.
  [[nodiscard]] const AnchoredLine& line(LineId id) const { return tracks_.at(id).line; }
  /// Lines that were archived.
  [[nodiscard]] const LineMap& map() const { return map_; }

 private:
  struct Observation {
    std::size_t window = 0;
    std::vector<LineBin> bins;
    bool rejected = false;
  };
  // The same in half the memory: a long journey keeps many.
  struct PastObservation {
    explicit PastObservation(const Observation& seen);
    [[nodiscard]] Observation observation() const;

   private:
    struct Bin {
      std::array<float, 9> px;  // a, b, their headings; scatter
      std::int32_t slot, count;
    };
    std::uint32_t window_;
    bool rejected_;
    std::vector<Bin> bins_;
  };
  // A line of the map that a track was found to be, as a factor on the track's coordinates.
  struct MapTie {
    ArchivedLine source;
    Vec4 at = Vec4::Zero();  // the archived line in the track's coordinates
    Eigen::Matrix4d whitening = Eigen::Matrix4d::Identity();
    std::size_t window = 0;  // in which it was found
    bool in_prior = false;
    [[nodiscard]] Vec4 residual(const AnchoredLine& line) const {
      return whitening * (line.coordinates - at);
    }
  };
  // Of a line that was mapped before its depth was known: a factor until it is. It never goes into the
  // marginal prior, where it would hold the world to the place of the line's anchor.
  struct DepthPrior {
    Vec4 at = Vec4::Zero();
    Eigen::Matrix<double, 3, 4> whitening = Eigen::Matrix<double, 3, 4>::Zero();
    [[nodiscard]] Vec3 residual(const AnchoredLine& line) const {
      return whitening * (line.coordinates - at);
    }
  };
  struct Track {
    bool sure = false, mapped = false, dead = false;
    bool archived = false;   // out of the problem; in the map, if it was good enough
    bool continued = false;  // another track was found to be the same line
    std::optional<MapTie> tie;
    std::optional<DepthPrior> depth_prior;
    AnchoredLine line;
    std::vector<Observation> seen;      // in the active windows
    std::vector<PastObservation> past;  // before them, for the last pass
    EventMeasurement end_a, end_b;      // of the newest observation
    std::vector<double> low, high;  // of recent observations' ends, along the line from the anchor's a [m]
    double from = 0, to = 0;        // extent that these say
    std::size_t first_window = 0, last_window = 0;
    int windows = 0;
    std::int64_t events = 0;
  };
  // The prior of an optimisation: about the lines in it alone, with its constant part of the normal
  // equations.
  struct ActivePrior {
    explicit ActivePrior(MarginalPrior of);
    MarginalPrior prior;
    Eigen::MatrixXd information;
  };
  struct WindowRows {  // from one state to the next
    ImuResidual imu;
    Eigen::Matrix<double, 8, 1> walk, walk_weight;  // biases, time shift, lag
    double rest_weight = 0, rest_turn_weight = 0;  // of the first state's velocity, of the turn to the second
    Vec3 turn = Vec3::Zero();
    double cost = 0;
  };
  // Normal equations of the lines seen at one bin time, to the camera's motion (BinResidual::d_camera).
  struct SightSystem {
    Eigen::Matrix<double, 7, kStateDim> by_state = Eigen::Matrix<double, 7, kStateDim>::Zero();
    Eigen::Matrix<double, 7, 7> H = Eigen::Matrix<double, 7, 7>::Zero();
    Eigen::Matrix<double, 7, 1> g = Eigen::Matrix<double, 7, 1>::Zero();
    Eigen::Matrix<double, 7, 4> by_camera =
        Eigen::Matrix<double, 7, 4>::Zero();             // to the camera's calibration
    Eigen::Matrix<double, 7, kImuIntrinsicsDim> by_imu;  // of the motion
  };
  struct Inertial {  // of one window
    Preintegrated motion;
    ImuBias linearised_at;
    BiasByIntrinsics by_intrinsics;
    Mat9 whitening;                    // W with W' W the inverse covariance
    Mat9 weight;                       // inverse covariance
    std::vector<Preintegrated> bins;   // to the bin times
    std::vector<TimedCamera> cameras;  // then, by the states as they are
  };

  void file(std::size_t window, LineObservation&& seen);
  void make_lines();
  [[nodiscard]] Pose camera_at(std::size_t window, const EventMeasurement& measured) const;
  [[nodiscard]] AnchoredLine new_line(const Track& track, double depth) const;
  [[nodiscard]] bool fit(const Track& track, const Eigen::Matrix4d& prior, AnchoredLine& line,
                         Eigen::Matrix4d& H, double& rms) const;
  [[nodiscard]] bool triangulate(Track& track) const;
  [[nodiscard]] bool initialise_with_depth_prior(Track& track) const;
  [[nodiscard]] bool knows_depth(const AnchoredLine& line, const Eigen::Matrix4d& information) const;
  [[nodiscard]] Eigen::Matrix4d line_information(const Track& track) const;
  [[nodiscard]] std::optional<LineId> known_line(const LineObservation& seen, std::size_t window) const;
  [[nodiscard]] double typical_depth() const;

  // What an optimisation changes: the active states, the calibration and some lines.
  struct Variables {
    std::vector<NavState> states;
    Eigen::VectorXd calibration;
    std::vector<AnchoredLine> lines;
  };
  [[nodiscard]] Variables variables(const std::vector<LineId>& ids) const;
  void set_variables(const Variables& to, const std::vector<LineId>& ids);
  void predict_end(std::size_t window);
  void move_cameras();
  [[nodiscard]] BinResidual residual(const LineBin& bin, const AnchoredLine& line, std::size_t window) const;
  [[nodiscard]] std::optional<Vec2> distances(const LineBin& bin, const AnchoredLine& line,
                                              std::size_t window) const;
  [[nodiscard]] SolveStats optimise(const std::vector<LineId>& ids, const ActivePrior& prior,
                                    int max_iterations, double enough);
  [[nodiscard]] SolveStats try_other_starts(SolveStats stats, const std::vector<LineId>& ids,
                                            const ActivePrior& prior);
  [[nodiscard]] bool keeps_past() const;
  [[nodiscard]] Eigen::Index column_of(const std::vector<LineId>& ids, LineId id) const;
  [[nodiscard]] std::vector<LineId> active_lines() const;
  [[nodiscard]] std::vector<LineId> longest(std::vector<LineId> ids) const;
  [[nodiscard]] ChainSystem linearise(const std::vector<LineId>& ids, const ActivePrior& prior) const;
  /// Calls `use(variables)` with the variables of a prior as they are now.
  template <class Use>
  auto with_prior_variables(Use&& use) const {
    const LineLookup line = [this](LineId id) -> const AnchoredLine& { return tracks_.at(id).line; };
    return use(PriorVariables{states_[first_], calibration_, line});
  }
  void add_prior(ChainSystem& system, const ActivePrior& prior, const std::vector<LineId>& ids) const;
  void add_inertial_rows(RowStack& rows, std::size_t window, Eigen::Index next) const;
  void add_line_rows(RowStack& rows, std::size_t window, const std::vector<LineId>& ids) const;
  void add_window(ChainSystem& system, std::size_t window, std::size_t slot) const;
  [[nodiscard]] WindowRows window_rows(std::size_t window) const;
  [[nodiscard]] std::pair<double, double> robust(const LineBin& bin, const Vec2& distances) const;
  void add_observation(ChainSystem& system, std::vector<SightSystem>& sights, const Track& track,
                       const Observation& seen, std::size_t slot, Eigen::Index column) const;
  [[nodiscard]] std::vector<SightSystem> sight_systems(std::size_t window) const;
  void add_sights(ChainSystem& system, const std::vector<SightSystem>& sights, std::size_t slot) const;
  void add_imu_columns(ChainSystem& system, std::size_t slot,
                       const Eigen::Matrix<double, kStateDim, kImuIntrinsicsDim>& by_state,
                       const Eigen::Matrix<double, kImuIntrinsicsDim, kImuIntrinsicsDim>& by_imu) const;
  [[nodiscard]] double cost(const std::vector<LineId>& ids, const ActivePrior& prior) const;
  void update_dormant_lines(const MarginalPrior::Reduction& reduction);
  void archive(const MarginalPrior::Reduction& reduction, const std::vector<LineId>& ids);
  void associate_with_map();
  [[nodiscard]] bool tie(LineId id, const ArchivedLine& source);
  void release(Track& track);
  [[nodiscard]] static std::pair<double, double> robust(const Vec4& tie_residual);
  void add_line_factors(ChainSystem& system, const std::vector<LineId>& ids) const;
  void add_tie_rows(RowStack& rows, std::size_t window, const std::vector<LineId>& ids);
  void apply(const ChainSystem::Step& step, const std::vector<LineId>& ids);
  void marginalise_oldest();
  void drop_past();
  [[nodiscard]] bool lost() const;
  [[nodiscard]] bool diverged(const NavState& state) const;
  [[nodiscard]] bool newest_misfits() const;
  // A line of the map that the newest window has seen.
  [[nodiscard]] bool in_sight(const Track& track) const {
    return track.mapped && !track.dead && !track.seen.empty() && track.last_window + 1 == windows_.size();
  }
  [[nodiscard]] bool knows_velocity() const;
  void restart();
  void set_prior(const NavState& first, bool still, double position_sigma, double yaw_sigma);
  void forget();
  void cull();
  void measure_extents();
  [[nodiscard]] double rms_px(const Track& track, const Observation& seen) const;
  [[nodiscard]] static double widening(const LineBin& bin);
  [[nodiscard]] double sigma_px(const LineBin& bin) const;
  [[nodiscard]] SolveStats newest_stats() const;
  [[nodiscard]] Line line_of(LineId id, const Track& track) const;

  // Until velocity and tilt of a start in motion are known, everything is solved to the end, without leaving
  // anything behind: scale, tilt and velocity change together, at hardly any cost, over a long way.
  static constexpr double kEnoughToSettle = 1e-5;
  static constexpr int kIterationsToSettle = 30;

  BackendOptions options_;
  Projection nominal_;  // the rig as it was given
  // What does not change during a run. Camera, unless it is known: rotation in the IMU's frame [rad], log of
  // the focal length; then the IMU's intrinsics, unless they are known.
  Eigen::VectorXd calibration_;
  Eigen::Index camera_dim_ = 0, imu_dim_ = 0, calibration_dim_ = 0;
  std::size_t first_ = 0;                            // oldest active state
  std::vector<std::unique_ptr<Inertial>> inertial_;  // null once no last pass will need it
  std::map<LineId, Track> tracks_;
  LineMap map_;
  std::map<LineId, std::pair<LineId, int>>
      proposed_;                    // of tracks: the line of the map and how often in a row
  std::map<LineId, LineId> alias_;  // of a segment that turned out to be a known line
  MarginalPrior prior_, gauge_;
  std::size_t dropped_ = 0;  // windows without inertial_
  double blind_s_ = 0;       // how long no known line has been seen, in motion
  double misfit_s_ = 0;      // how long many have been where they should not be
  int restarts_ = 0;
  std::size_t begun_ = 0;               // first state since
  std::optional<StateMat> covariance_;  // of the newest state
  bool settled_ = false;
};

}  // namespace idol
