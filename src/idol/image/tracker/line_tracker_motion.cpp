// How live lines move: each by constant rates and the gyro's turns, along itself with the flow of all.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "idol/base/median.hpp"
#include "idol/image/tracker/line_tracker.hpp"

namespace idol {
namespace {

constexpr double kSlowestMotionScale = 0.1;  // [s/px]
constexpr double kFlowSigma = 0.2;     // of a line's motion about the flow, over the usual speed
// Spectral density of the image acceleration over the square of the usual speed [1/s], and the least speed
// [px/s]: motion may begin at any time.
constexpr double kAcceleration = 10, kLeastUsual = 60;

// E P E^T, where E adds `factor` of one coordinate to another.
template <int to, int from>
void shear(Eigen::Matrix4d& P, double factor) {
  P.row(to) += factor * P.row(from);
  P.col(to) += factor * P.col(from);
}

}  // namespace

// A turn moves the whole image in a known way: what it changes, no line has to learn from its events.
void LineTracker::turn(Time from, const Vec3& omega) {
  if (omega_) {
    const Vec3 change = omega - *omega_;
    const auto turn_one = [&](LineTrack& track) {
      advance(track, from);
      const Eigen::Vector2d half = std::max(1.0, 0.5 * (track.hi - track.lo)) * track.dir;
      const Eigen::Vector2d a = undistort_->rotational_flow(track.centre - half, change);
      const Eigen::Vector2d b = undistort_->rotational_flow(track.centre + half, change);
      track.x[2] += track.normal.dot(a + b) / 2;
      track.x[3] += track.normal.dot(b - a) / (2 * half.norm());
    };
    std::for_each(tracks_.begin(), tracks_.end(), turn_one);
    std::for_each(lost_.begin(), lost_.end(), turn_one);
  }
  omega_ = omega;
}

// Constant velocity; the frame moves along so that offset and slope are zero again.
void LineTracker::predict(LineTrack& track, Time t) const {
  const double dt = seconds_between(track.time, t);
  if (dt > 0) {
    track.x.head<2>() += dt * track.x.tail<2>();
    shear<0, 2>(track.P, dt);
    shear<1, 3>(track.P, dt);
    const double half = std::max(10.0, 0.5 * (track.hi - track.lo));
    const double density = kAcceleration * usual_speed_ * usual_speed_;
    for (int k = 0; k < 2; ++k) {
      const double q = k == 0 ? density : density / (half * half);
      track.P(k, k) += q * dt * dt * dt / 3;
      track.P(k, k + 2) += q * dt * dt / 2;
      track.P(k + 2, k) += q * dt * dt / 2;
      track.P(k + 2, k + 2) += q * dt;
    }
    track.time = t;
    track.waiting.t -= track.waiting.n * dt;
    // A line shows no motion along itself; the other lines do.
    track.centre += track.dir.dot(flow(track.centre)) * dt * track.dir;
  }
  // The origin goes to the middle of the extent, where offset and slope are least coupled. Ends move seldom.
  if (const double mid = 0.5 * (track.lo + track.hi); mid != 0) {
    track.x[0] += track.x[1] * mid;
    track.x[2] += track.x[3] * mid;
    shear<0, 1>(track.P, mid);
    shear<2, 3>(track.P, mid);
    track.centre += mid * track.dir;
    track.lo -= mid;
    track.hi -= mid;
    auto& waiting = track.waiting;
    waiting.uu += mid * (waiting.n * mid - 2 * waiting.u);
    waiting.u -= waiting.n * mid;
    waiting.ur -= mid * waiting.r;
    track.along_at -= mid;
  }
  track.centre += track.x[0] * track.normal;
  track.dir = (track.dir + track.x[1] * track.normal).normalized();
  track.normal = {-track.dir.y(), track.dir.x()};
  track.x[0] = track.x[1] = 0;
}

void LineTracker::advance(LineTrack& track, Time t) const {
  const double way = seconds_between(track.time, t) * std::abs(track.x[2]);
  track.travel += way;
  track.fresh_travel += way;
  predict(track, t);
}

// One pixel of motion should count like one pixel of distance: c = 1 / median speed, followed slowly.
void LineTracker::adapt_scale() {
  std::vector<double> speeds;
  for (const auto& t : tracks_)
    if (t.validated || t.travel > 1) speeds.push_back(std::abs(t.x[2]));
  double turn = 0;
  if (omega_) {
    const Eigen::Vector2d centre(0.5 * undistort_->width(), 0.5 * undistort_->height());
    turn = undistort_->rotational_flow(centre, *omega_).norm();
  }
  if (speeds.empty()) {
    usual_speed_ = std::max({kLeastUsual, turn, 0.98 * usual_speed_});
    return;
  }
  const double middle = std::max(1.0, median(speeds));
  double squares = 0;
  for (const double v : speeds) squares += v * v / static_cast<double>(speeds.size());
  usual_speed_ = std::max({kLeastUsual, turn, std::sqrt(squares)});
  const double wanted = std::clamp(1.0 / middle, kFastestScale, kSlowestMotionScale);
  c_ = std::exp(0.9 * std::log(c_) + 0.1 * std::log(wanted));
}

Eigen::Vector2d LineTracker::flow(const Eigen::Vector2d& px) const {
  const Eigen::Vector2d at =
      2.0 / undistort_->width() * px - Eigen::Vector2d(1, 1.0 * undistort_->height() / undistort_->width());
  return flow_ * Eigen::Vector3d(1, at.x(), at.y());
}

// Every line's motion across itself is a measurement of the flow at its middle. The change over the image is
// expected to be smaller than the flow; where a line moves unlike the rest, it counts less.
void LineTracker::fit_flow() {
  using Vec6 = Eigen::Matrix<double, 6, 1>;
  Eigen::Matrix<double, 6, 6> H = Eigen::Matrix<double, 6, 6>::Zero();
  Vec6 b = Vec6::Zero();
  const double sigma = kFlowSigma / std::max(c_, 1e-3);
  for (const LineTrack& t : tracks_) {
    if (!t.validated) continue;
    const double off = t.x[2] - t.normal.dot(flow(t.centre));
    const double weight = 1 / (sigma * sigma + t.P(2, 2) + off * off);
    const Eigen::Vector2d at = 2.0 / undistort_->width() * t.centre -
                               Eigen::Vector2d(1, 1.0 * undistort_->height() / undistort_->width());
    const Eigen::Vector3d p(1, at.x(), at.y());
    Vec6 a;
    a << t.normal.x() * p, t.normal.y() * p;
    H += weight * a * a.transpose();
    b += weight * t.x[2] * a;
  }
  const double uniform = 3 / c_, change = 0.5 / c_;
  const Eigen::Vector3d prior(1 / (uniform * uniform), 1 / (change * change), 1 / (change * change));
  H.diagonal() += (Vec6() << prior, prior).finished();
  const Vec6 x = H.ldlt().solve(b);
  flow_.row(0) = x.head<3>().transpose();
  flow_.row(1) = x.tail<3>().transpose();
}

}  // namespace idol
