// The true lines of a simulated recording in the image, at any time.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <vector>

#include "idol/base/camera.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/table.hpp"

namespace idol::bench {

/// A true line in the undistorted image, cut to what the camera can see. Pieces of one straight line, such as
/// the panes of a window, have one number.
struct TrueImage {
  int line = 0;
  Vec2 a, b;
  double length = 0;  ///< of what lies on the sensor [px]
};

class TrueLines {
 public:
  TrueLines(const std::filesystem::path& sequence, const Camera& camera) : camera_(camera) {
    read_table(sequence / "lines_truth.csv", "ax,ay,az,bx,by,bz,kind,group,contrast",
               [&](const TableRow& row) {
                 if (row.integer(7) < 0) ends_.push_back({row.vec3(0), row.vec3(3)});
               });
    const auto truth = read_groundtruth(sequence);
    if (!truth) throw DataError(sequence.string() + ": no ground truth");
    poses_ = *truth;
    for (int k = 0; k < camera.width; ++k) widen(Vec2(k, 0)), widen(Vec2(k, camera.height - 1));
    for (int k = 0; k < camera.height; ++k) widen(Vec2(0, k)), widen(Vec2(camera.width - 1, k));
    view_ = (1.05 * view_).cwiseMin(kWidest);
    join_collinear();
  }

  /// How long after the edge its events come [s].
  void set_trail(double trail_s) { trail_s_ = trail_s; }

  /// Edges whose events arrive at `t`.
  [[nodiscard]] std::vector<TrueImage> seen(Time t) const {
    const Pose T_c_w = pose(t - from_seconds(trail_s_)).inverse();
    std::vector<TrueImage> out;
    for (int k = 0; k < static_cast<int>(ends_.size()); ++k)
      if (const auto line = image(k, T_c_w)) out.push_back(*line);
    return out;
  }

  /// One of them, if it is in view.
  [[nodiscard]] std::optional<TrueImage> seen(int line, Time t) const {
    if (line < 0) return std::nullopt;
    return image(line, pose(t - from_seconds(trail_s_)).inverse());
  }

 private:
  static constexpr double kWidest = 1.2;  // beyond these normalised coordinates distortion models turn around

  struct Ends {
    Vec3 a, b;
    int first = -1;  // of the pieces of its straight line
  };

  void join_collinear() {
    constexpr double kAngle = 0.01, kOff = 0.005;  // [rad], [m]
    for (int k = 0; k < static_cast<int>(ends_.size()); ++k) {
      Ends& mine = ends_[static_cast<std::size_t>(k)];
      const Vec3 dir = (mine.b - mine.a).normalized();
      mine.first = k;
      for (int j = 0; j < k && mine.first == k; ++j) {
        const Ends& other = ends_[static_cast<std::size_t>(j)];
        const Vec3 along = (other.b - other.a).normalized();
        const auto off = [&](const Vec3& x) { return along.cross(x - other.a).norm(); };
        if (along.cross(dir).norm() < kAngle && off(mine.a) < kOff && off(mine.b) < kOff)
          mine.first = other.first;
      }
    }
  }

  void widen(const Vec2& border_px) {
    const Vec2 px = camera_.undistort(border_px);
    view_ = view_.cwiseMax(camera_.normalise(px).cwiseAbs());
  }

  [[nodiscard]] std::optional<TrueImage> image(int line, const Pose& T_c_w) const {
    const Ends& ends = ends_[static_cast<std::size_t>(line)];
    Vec3 a = T_c_w * ends.a, b = T_c_w * ends.b;
    constexpr double kNear = 0.05;
    if (a.z() < kNear && b.z() < kNear) return std::nullopt;
    if (a.z() < kNear) a = b + (b.z() - kNear) / (b.z() - a.z()) * (a - b);
    if (b.z() < kNear) b = a + (a.z() - kNear) / (a.z() - b.z()) * (b - a);
    for (int axis = 0; axis < 2; ++axis) {  // most lines are beside the view
      const double reach_a = view_[axis] * a.z(), reach_b = view_[axis] * b.z();
      if ((a[axis] > reach_a && b[axis] > reach_b) || (a[axis] < -reach_a && b[axis] < -reach_b))
        return std::nullopt;
    }
    const TrueImage out = on_sensor(ends.first, a, b);
    return out.length > 0 ? std::optional(out) : std::nullopt;
  }

  [[nodiscard]] Pose pose(Time t) const {
    auto after = std::lower_bound(poses_.begin(), poses_.end(), t,
                                  [](const StampedPose& p, Time time) { return p.t < time; });
    after = std::clamp(after, poses_.begin() + 1, poses_.end() - 1);
    const auto before = after - 1;
    const double alpha = seconds_between(before->t, t) / seconds_between(before->t, after->t);
    return interpolate(before->T, after->T, std::clamp(alpha, 0.0, 1.0));
  }

  // The part between the first and the last of some points on it that the sensor sees.
  [[nodiscard]] TrueImage on_sensor(int line, const Vec3& a, const Vec3& b) const {
    constexpr int kSteps = 40;
    const auto visible = [&](int k) {
      const Vec3 x = a + (b - a) * k / kSteps;
      const Vec2 m(x.x() / x.z(), x.y() / x.z());
      if (m.norm() > kWidest) return false;
      const Vec2 px = camera_.distort(m);
      return px.x() >= 0 && px.y() >= 0 && px.x() <= camera_.width - 1 && px.y() <= camera_.height - 1;
    };
    int first = 0, last = kSteps;
    while (first <= last && !visible(first)) ++first;
    while (last > first && !visible(last)) --last;
    TrueImage out;
    out.line = line;
    if (first > last) return out;
    out.a = camera_.project(a + (b - a) * first / kSteps);
    out.b = camera_.project(a + (b - a) * last / kSteps);
    out.length = (out.b - out.a).norm();
    return out;
  }

  Camera camera_;
  Vec2 view_ = Vec2::Zero();  // largest normalised coordinates that the sensor sees, and some more
  std::vector<Ends> ends_;
  Trajectory poses_;
  double trail_s_ = 0.0007;
};

inline double distance_to_segment(const Vec2& p, const TrueImage& line) {
  const Vec2 d = line.b - line.a;
  const double u = std::clamp((p - line.a).dot(d) / std::max(1e-12, d.squaredNorm()), 0.0, 1.0);
  return (p - line.a - u * d).norm();
}

}  // namespace idol::bench
