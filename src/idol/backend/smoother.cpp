#include "idol/backend/smoother.hpp"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>

#include "idol/backend/costs.hpp"
#include "idol/base/median.hpp"

namespace idol {
namespace {

ceres::Problem::Options borrowing_manifolds() {
  ceres::Problem::Options options;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

LineNoise line_noise(const BackendOptions& options) {
  return {options.event_sigma_px, options.huber_sigmas, options.repulsion_sigma_px, options.attraction_sigma};
}

// A few pixels along the line, as a length at the line's distance.
double end_damping_m(const Pose& T_w_c, const LineEnds& ends, const Camera& camera) {
  constexpr double kPixels = 3;
  const double distance = (0.5 * (ends.a + ends.b) - T_w_c.p).norm();
  return kPixels * std::max(distance, 0.05) / camera.fx;
}

}  // namespace

// One non-linear least-squares problem over the active states and lines (paper eq. 3).
class Smoother::Problem {
 public:
  Problem(const Smoother& owner, std::size_t first)
      : owner_(owner), first_(first), problem_(borrowing_manifolds()) {
    for (std::size_t i = first_; i < owner_.states_.size(); ++i)
      parameters_.push_back(to_parameters(owner_.states_[i]));
    for (auto& p : parameters_) {
      problem_.AddParameterBlock(p.pose.data(), kPoseSize, &pose_manifold_);
      problem_.AddParameterBlock(p.motion.data(), kMotionSize);
    }
    fix_gauge();
    add_inertial();
    lines_.reserve(owner_.tracks_.size());
    for (const auto& [id, track] : owner_.tracks_)
      if (track.mapped && !track.dead) add_line(id, track);
  }

  ceres::Solver::Summary solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.max_num_iterations = owner_.options_.max_iterations;
    options.function_tolerance = 1e-5;
    // Nearly Gauss-Newton: damping each bias of the stiff random-walk chain would hold all of them in place.
    options.initial_trust_region_radius = 1e10;
    options.num_threads = 1;  // sums in one order: the same bits every time
    options.logging_type = ceres::SILENT;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (auto& [id, ends] : lines_) ordering->AddElementToGroup(ends.data(), 0);
    for (auto& p : parameters_) {
      ordering->AddElementToGroup(p.pose.data(), 1);
      ordering->AddElementToGroup(p.motion.data(), 1);
    }
    options.linear_solver_ordering = ordering;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }

  void write_back(Smoother& owner) const {
    for (std::size_t k = 0; k < parameters_.size(); ++k) {
      NavState& state = owner.states_[first_ + k];
      const Time t = state.t;
      state = from_parameters(parameters_[k].pose.data(), parameters_[k].motion.data());
      state.t = t;
    }
    for (const auto& [id, ends] : lines_) owner.tracks_.at(id).ends = {ends.head<3>(), ends.tail<3>()};
  }

  [[nodiscard]] int lines() const { return static_cast<int>(lines_.size()); }

 private:
  StateParameters& at(std::size_t window) { return parameters_[window - first_]; }

  // Position and yaw of the first pose in the batch; the whole oldest pose in the sliding window (paper VI).
  void fix_gauge() {
    StateParameters& oldest = parameters_.front();
    const NavState& state = owner_.states_[first_];
    Eigen::Matrix<double, 9, 1> mean, sigma;
    if (first_ == 0) {
      problem_.SetManifold(oldest.pose.data(), &tilt_manifold_);
      const auto& o = owner_.options_;
      mean << Vec3::Zero(), owner_.first_guess_.bias.gyro, owner_.first_guess_.bias.accel;
      sigma.head<3>().setConstant(owner_.still_start_ ? o.start_velocity_sigma : o.moving_velocity_sigma);
      sigma.segment<3>(3).setConstant(owner_.still_start_ ? o.gyro_bias_sigma : o.moving_gyro_bias_sigma);
      sigma.tail<3>().setConstant(o.accel_bias_sigma);
    } else {
      problem_.SetParameterBlockConstant(oldest.pose.data());
      mean << state.v_w, state.bias.gyro, state.bias.accel;
      sigma << Vec3::Constant(0.1), Vec3::Constant(0.002), Vec3::Constant(0.05);
    }
    problem_.AddResidualBlock(motion_prior_cost(mean, sigma).release(), nullptr, oldest.motion.data());
  }

  void add_inertial() {
    for (std::size_t w = first_; w < owner_.windows_.size(); ++w) {
      const Preintegration& imu = *owner_.windows_[w].imu;
      const Preintegrated motion = imu.at(imu.end());
      problem_.AddResidualBlock(
          imu_cost(motion, imu.covariance(imu.end()), imu.bias(), owner_.projection_.gravity).release(),
          nullptr, at(w).pose.data(), at(w).motion.data(), at(w + 1).pose.data(), at(w + 1).motion.data());
      problem_.AddResidualBlock(bias_walk_cost(owner_.noise_, motion.dt).release(), nullptr,
                                at(w).motion.data(), at(w + 1).motion.data());
      if (owner_.windows_[w].still) {
        Eigen::Matrix<double, 9, 1> sigma = Eigen::Matrix<double, 9, 1>::Constant(1e6);
        sigma.head<3>().setConstant(owner_.options_.start_velocity_sigma);
        problem_.AddResidualBlock(motion_prior_cost(Eigen::Matrix<double, 9, 1>::Zero(), sigma).release(),
                                  nullptr, at(w).motion.data());
      }
    }
  }

  void add_line(LineId id, const Track& track) {
    const LineNoise noise = line_noise(owner_.options_);
    bool attracted = false;
    for (const auto& o : track.observations) {
      if (o.window < first_ || o.rejected) continue;
      const Preintegration& imu = *owner_.windows_[o.window].imu;
      if (!attracted) {
        // The window that first saw the line, or the oldest one still active.
        attracted = true;
        auto& ends = lines_.emplace_back(id, Eigen::Matrix<double, kLineSize, 1>::Zero()).second;
        ends << track.ends.a, track.ends.b;
        const auto manifold = line_manifolds_.try_emplace(id, track.T_w_c_first).first;
        problem_.AddParameterBlock(ends.data(), kLineSize, &manifold->second);
        problem_.AddResidualBlock(
            attraction_cost(o.seen.end_a.motion, imu.bias(), owner_.projection_, noise).release(), nullptr,
            at(o.window).pose.data(), at(o.window).motion.data(), ends.data());
        problem_.AddResidualBlock(
            depth_prior_cost(track.T_w_c_first, track.prior_depth, owner_.options_.depth_prior_log,
                             owner_.options_.slant_prior_log)
                .release(),
            nullptr, ends.data());
        problem_.AddResidualBlock(end_damping_cost(track.ends, end_damping_m(track.T_w_c_first, track.ends,
                                                                             owner_.projection_.camera))
                                      .release(),
                                  nullptr, ends.data());
      }
      auto& ends = lines_.back().second;
      problem_.AddResidualBlock(
          event_line_cost(o.seen.events, imu.bias(), owner_.projection_, noise).release(),
          observation_loss(o.seen.events.size()), at(o.window).pose.data(), at(o.window).motion.data(),
          ends.data());
    }
  }

  // The events of one observation err together (a wrong link, a corner): they are doubted together.
  [[nodiscard]] ceres::LossFunction* observation_loss(std::size_t events) const {
    const double sigmas = owner_.options_.observation_sigmas;
    if (sigmas <= 0) return nullptr;
    return new ceres::CauchyLoss(sigmas * std::sqrt(static_cast<double>(events)));
  }

  const Smoother& owner_;
  std::size_t first_;
  PoseManifold pose_manifold_;
  TiltManifold tilt_manifold_;
  std::vector<StateParameters> parameters_;
  // In one array: Ceres orders blocks by address, which must not depend on where memory happened to be free.
  std::vector<std::pair<LineId, Eigen::Matrix<double, kLineSize, 1>>> lines_;
  std::map<LineId, LineManifold> line_manifolds_;
  ceres::Problem problem_;
};

Smoother::Smoother(const Rig& rig, const BackendOptions& options)
    : Backend(rig, options.gravity), options_(options) {}

void Smoother::start(const NavState& first, bool still) {
  states_ = {first};
  first_guess_ = first;
  still_start_ = still;
}

void Smoother::add(WindowMeasurement window) {
  const std::size_t index = windows_.size();
  append(window);
  for (auto& seen : window.lines) {
    const LineId id = seen.id;
    tracks_[id].observations.push_back({index, std::move(seen), false});
  }
}

std::size_t Smoother::first_active() const {
  if (seconds_between(states_.front().t, states_.back().t) <= options_.batch_s) return 0;
  return states_.size() - std::min(states_.size(), static_cast<std::size_t>(options_.lag_windows) + 1);
}

SolveStats Smoother::solve() {
  make_lines();
  Problem problem(*this, first_active());
  const auto summary = problem.solve();
  if (summary.IsSolutionUsable()) problem.write_back(*this);
  cull();
  SolveStats stats = newest_stats();
  stats.lines = problem.lines();
  stats.residuals = summary.num_residuals;
  stats.iterations = static_cast<int>(summary.iterations.size());
  stats.cost = summary.final_cost;
  return stats;
}

NavState Smoother::state_of(const Observation& o, const EventMeasurement& e) const {
  return predict(states_[o.window], e.motion, windows_[o.window].bias, projection_.gravity);
}

double Smoother::observation_rms(const Track& track, const Observation& o) const {
  double sum = 0;
  const ImuBias& bias = windows_[o.window].bias;
  for (const auto& e : o.seen.events) {
    const TimedCamera camera(states_[o.window], e.motion, bias, projection_);
    const auto a = camera({track.ends.a}), b = camera({track.ends.b});
    const LineResidual r = event_to_line(e, a, b, projection_.camera);
    sum += r.valid ? r.value * r.value : 1e6;
  }
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, o.seen.events.size())));
}

// Median depth of the lines in the newest camera.
double Smoother::typical_depth() const {
  const Pose T_c_w = (states_.back().T_w_i * projection_.T_i_c).inverse();
  std::vector<double> depths;
  for (const auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead || track.observations.size() < 5) continue;
    const double z = (T_c_w * Vec3(0.5 * (track.ends.a + track.ends.b))).z();
    if (z > 0.1) depths.push_back(z);
  }
  return depths.size() < 3 ? options_.first_depth_m : median(std::move(depths));
}

void Smoother::make_lines() {
  for (auto& [id, track] : tracks_) {
    if (track.mapped || track.dead || track.observations.back().window + 1 != windows_.size()) continue;
    if (std::ssize(track.observations) < options_.min_windows) continue;
    track.mapped = initialise(track);
  }
}

// Both ends of the first observation, put at the same depth; then a fit of the line alone to all its events
// from several depths. The best fit wins; without parallax all fit alike and the prior decides.
bool Smoother::initialise(Track& track) const {
  const double typical = typical_depth();
  const Observation& seen_first = track.observations.front();
  const Pose T_w_c = state_of(seen_first, seen_first.seen.end_a).T_w_i * projection_.T_i_c;
  track.T_w_c_first = T_w_c;
  track.prior_depth = typical;
  LineManifold manifold(T_w_c);
  double best = std::numeric_limits<double>::infinity();
  for (double factor : {1.0, 0.5, 2.0}) {
    const auto back_project = [&](const EventMeasurement& end) -> Vec3 {
      const Vec2 m = projection_.camera.normalise(end.px);
      return T_w_c * (typical * factor * Vec3(m.x(), m.y(), 1));
    };
    Eigen::Matrix<double, kLineSize, 1> ends;
    ends << back_project(seen_first.seen.end_a), back_project(seen_first.seen.end_b);
    ceres::Problem problem(borrowing_manifolds());
    problem.AddParameterBlock(ends.data(), kLineSize, &manifold);
    std::map<std::size_t, StateParameters> parameters;
    for (const auto& o : track.observations) {
      const auto [it, fresh] = parameters.try_emplace(o.window, to_parameters(states_[o.window]));
      problem.AddResidualBlock(
          event_line_cost(o.seen.events, windows_[o.window].bias, projection_, line_noise(options_))
              .release(),
          nullptr, it->second.pose.data(), it->second.motion.data(), ends.data());
      problem.SetParameterBlockConstant(it->second.pose.data());
      problem.SetParameterBlockConstant(it->second.motion.data());
    }
    problem.AddResidualBlock(
        depth_prior_cost(T_w_c, typical, options_.depth_prior_log, options_.slant_prior_log).release(),
        nullptr, ends.data());
    const LineEnds begin{ends.head<3>(), ends.tail<3>()};
    problem.AddResidualBlock(
        end_damping_cost(begin, end_damping_m(T_w_c, begin, projection_.camera)).release(), nullptr,
        ends.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 20;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (!summary.IsSolutionUsable() || summary.final_cost >= best) continue;
    best = summary.final_cost;
    track.ends = {ends.head<3>(), ends.tail<3>()};
  }
  return std::isfinite(best) && observation_rms(track, track.observations.back()) < options_.cull_px;
}

// Leaves out observations that do not fit; a line that keeps less than half of them, or lies behind the
// camera that first saw it, is dead.
void Smoother::cull() {
  const std::size_t first = first_active();
  for (auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead || track.observations.back().window < first) continue;
    std::size_t kept = 0;
    for (auto& o : track.observations) {
      if (o.window >= first) o.rejected = observation_rms(track, o) > options_.cull_px;
      if (!o.rejected) ++kept;
    }
    const Pose T_c_w = track.T_w_c_first.inverse();
    const double nearest = std::min((T_c_w * track.ends.a).z(), (T_c_w * track.ends.b).z());
    track.dead = 2 * kept < track.observations.size() || nearest < 0.05;
  }
}

SolveStats Smoother::newest_stats() const {
  SolveStats stats;
  int seen = 0;
  double squares = 0;
  for (const auto& [id, track] : tracks_) {
    const Observation& o = track.observations.back();
    if (!track.mapped || track.dead || o.window + 1 != windows_.size()) continue;
    ++seen;
    squares += std::pow(observation_rms(track, o), 2);
    stats.mean_track_s += seconds_between(states_[track.observations.front().window].t, states_.back().t);
  }
  if (seen == 0) return stats;
  stats.rms_px = std::sqrt(squares / seen);
  stats.mean_track_s /= seen;
  return stats;
}

std::size_t Smoother::line_count() const {
  return static_cast<std::size_t>(std::count_if(
      tracks_.begin(), tracks_.end(), [](const auto& t) { return t.second.mapped && !t.second.dead; }));
}

std::vector<Line> Smoother::lines() const {
  std::vector<Line> out;
  for (const auto& [id, track] : tracks_) {
    if (!track.mapped || track.dead) continue;
    Line line;
    line.id = id;
    line.a = track.ends.a;
    line.b = track.ends.b;
    line.first = states_[track.observations.front().window].t;
    line.last = states_[track.observations.back().window + 1].t;
    line.windows = static_cast<int>(track.observations.size());
    for (const auto& o : track.observations) line.events += o.seen.event_count;
    out.push_back(line);
  }
  return out;
}

}  // namespace idol
