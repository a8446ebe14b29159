// The estimator: states, lines and the problem over them. Full batch at first, then the last windows (paper
// VI).
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "idol/backend/backend.hpp"
#include "idol/backend/backend_options.hpp"
#include "idol/base/options.hpp"
#include "idol/base/rig.hpp"
#include "idol/imu/imu_init.hpp"
#include "idol/imu/preintegration.hpp"

namespace idol {

/// The paper's schedule: a growing full batch, then the last windows with the oldest pose fixed.
class Smoother : public Backend {
 public:
  Smoother(const Rig& rig, const BackendOptions& options);

  void start(const NavState& first, bool still) override;
  void add(WindowMeasurement window) override;
  SolveStats solve() override;
  [[nodiscard]] std::vector<Line> lines() const override;
  [[nodiscard]] std::size_t line_count() const override;

 private:
  struct Observation {
    std::size_t window = 0;
    LineObservation seen;
    bool rejected = false;
  };
  struct Track {
    bool mapped = false;
    bool dead = false;
    LineEnds ends;
    Pose T_w_c_first;  // camera when the depth prior was set
    double prior_depth = 0;
    std::vector<Observation> observations;
  };
  class Problem;

  [[nodiscard]] std::size_t first_active() const;
  [[nodiscard]] NavState state_of(const Observation& o, const EventMeasurement& e) const;
  [[nodiscard]] double observation_rms(const Track& track, const Observation& o) const;
  [[nodiscard]] double typical_depth() const;
  void make_lines();
  [[nodiscard]] bool initialise(Track& track) const;
  void cull();
  [[nodiscard]] SolveStats newest_stats() const;

  BackendOptions options_;
  std::map<LineId, Track> tracks_;
  bool still_start_ = false;
  NavState first_guess_;
};

}  // namespace idol
