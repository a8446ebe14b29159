#include "idol/jobs/gyro_image_check.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/base/signed_axes.hpp"

namespace idol {
namespace {

constexpr std::size_t kMostSamples = 40'000, kMostTurns = 400;
constexpr std::size_t kFewestSegments = 6, kFewestTurns = 20;

/// Least squares for rates and velocity over depth from how lines move across themselves: only that part of
/// their motion shows. Both are held to what a hand does, which decides what a narrow view leaves open
/// between them.
class TurnFit {
 public:
  explicit TurnFit(const UndistortMap& undistort, const Camera& camera)
      : undistort_(undistort), camera_(camera) {}

  void add(const MovingLine& line, double t) {
    constexpr double kStep = 1e-3;  // [s]
    const Vec2 along = line.point(line.u_max, t) - line.point(line.u_min, t);
    const Vec2 normal = Vec2(-along.y(), along.x()).normalized();
    for (const double share : {0.2, 0.8}) {
      const double u = line.u_min + share * (line.u_max - line.u_min);
      const Vec2 px = line.point(u, t);
      const double speed = normal.dot(line.point(u, t + kStep) - line.point(u, t - kStep)) / (2 * kStep);
      Eigen::Matrix<double, 6, 1> row;
      for (Eigen::Index k = 0; k < 3; ++k) row[k] = normal.dot(undistort_.rotational_flow(px, Vec3::Unit(k)));
      const Vec2 m((px.x() - camera_.cx) / camera_.fx, (px.y() - camera_.cy) / camera_.fy);
      const Vec2 n(normal.x() * camera_.fx, normal.y() * camera_.fy);
      row.tail<3>() << -n.x(), -n.y(), n.dot(m);
      constexpr double kSigma = 20;  // [px/s]
      N_ += row * row.transpose() / (kSigma * kSigma);
      b_ += row * speed / (kSigma * kSigma);
    }
  }
  [[nodiscard]] Vec3 omega() const {
    constexpr double kRate = 1.0, kVelocity = 0.5;  // [rad/s], [1/s]
    Eigen::Matrix<double, 6, 6> N = N_;
    for (Eigen::Index i = 0; i < 6; ++i) N(i, i) += 1 / std::pow(i < 3 ? kRate : kVelocity, 2);
    return N.ldlt().solve(b_).head<3>();
  }

 private:
  const UndistortMap& undistort_;
  const Camera& camera_;
  Eigen::Matrix<double, 6, 6> N_ = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> b_ = Eigen::Matrix<double, 6, 1>::Zero();
};

}  // namespace

void GyroImageCheck::add(const ImuSample& sample) {
  if (samples_.size() < kMostSamples) samples_.push_back(sample);
}

void GyroImageCheck::add(const Estimate& estimate) {
  if (turns_.size() >= kMostTurns) return;
  const EventWindow& window = estimate.window;
  const double middle = 0.5 * seconds_between(window.begin, window.end);
  TurnFit fit(undistort_, rig_.camera);
  std::size_t count = 0;
  for (const Segment& segment : estimate.segments.segments) {
    if (!segment.straight) continue;
    fit.add(segment.line, middle);
    ++count;
  }
  if (count >= kFewestSegments) turns_.push_back({window.begin, window.end, fit.omega()});
}

Vec3 GyroImageCheck::mean_rate(Time begin, Time end) const {
  const auto from = std::lower_bound(samples_.begin(), samples_.end(), begin,
                                     [](const ImuSample& s, Time t) { return s.t < t; });
  Vec3 sum = Vec3::Zero();
  int count = 0;
  for (auto s = from; s != samples_.end() && s->t < end; ++s, ++count) sum += s->gyro;
  return count > 0 ? Vec3(sum / count) : Vec3(Vec3::Constant(std::nan("")));
}

void GyroImageCheck::report(Diagnostics& diagnostics) const {
  std::vector<Vec3> seen, read;
  for (const Turn& turn : turns_) {
    const Vec3 rate = mean_rate(turn.begin, turn.end);
    if (!rate.allFinite()) continue;
    seen.push_back(turn.omega);
    read.push_back(rate);
  }
  if (seen.size() < kFewestTurns) return;
  const Mat3 R_c_i = rig_.T_i_c.q.conjugate().toRotationMatrix();
  struct Fit {
    double match = -1, scale = 0;
  };
  const auto fit = [&](const SignedAxes& axes) {
    double both = 0, ss = 0, rr = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const Vec3 expected = R_c_i * axes.apply(read[i]);
      both += seen[i].dot(expected);
      ss += seen[i].squaredNorm();
      rr += expected.squaredNorm();
    }
    return Fit{ss > 0 && rr > 0 ? both / std::sqrt(ss * rr) : 0, rr > 0 ? both / rr : 0};
  };
  constexpr double kGood = 0.5, kMuchBetter = 0.3, kRadPerDeg = 0.0174533;
  const Fit stated = fit({});
  SignedAxes best;
  Fit most = stated;
  for (const SignedAxes& axes : all_signed_axes())
    if (const Fit found = fit(axes); found.match > most.match) {
      best = axes;
      most = found;
    }
  if (most.match > kGood && most.scale > kRadPerDeg / 3 && most.scale < 3 * kRadPerDeg)
    diagnostics.replace(
        "gyro_unit",
        fmt::format("the IMU's rates are about {:.0f} times what the lines in the image turn by: they look "
                    "like deg/s; rad/s are expected",
                    1 / most.scale),
        1);
  if (most.match > kGood && most.match - stated.match > kMuchBetter)
    diagnostics.replace(
        "gyro_axes",
        fmt::format("the lines in the image turn otherwise than the IMU's rates say; taken as {} these would "
                    "fit: are axes swapped, mirrored, or is the mounting (T_cam_imu) wrong?",
                    best.name()),
        1);
}

}  // namespace idol
