#include "idol/backend/anchored_line.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace idol {
namespace {

using Mat34 = Eigen::Matrix<double, 3, 4>;

}  // namespace

LineAnchor LineAnchor::from_image(const Pose& T_w_c, const Vec2& a_px, const Vec2& b_px,
                                  const Camera& camera) {
  LineAnchor out;
  out.T_w_c = T_w_c;
  out.a = camera.normalise(a_px);
  out.b = camera.normalise(b_px);
  const Vec2 along = (out.b - out.a).normalized();
  out.normal = {-along.y(), along.x()};
  return out;
}

HomogeneousPoint AnchoredLine::end(const Vec2& m, double offset, double inverse_depth) const {
  const Vec2 moved = m + offset * anchor.normal;
  return {anchor.T_w_c.q * Vec3(moved.x(), moved.y(), 1) + inverse_depth * anchor.T_w_c.p, inverse_depth};
}

void AnchoredLine::move(const Vec4& step) {
  const Vec4 c = coordinates, moved = c + step;
  coordinates << moved[0], std::max(moved[1], 0.1 * c[1]), moved[2], std::max(moved[3], 0.1 * c[3]);
}

bool AnchoredLine::finite() const {
  constexpr double kFarthest = 1e5, kNearest = 1e-3;  // [m]
  constexpr double kOffset = 2;                       // a lens of 90 degrees sees offsets up to 1
  const auto in_front = [](double inverse_depth) {
    return inverse_depth > 1 / kFarthest && inverse_depth < 1 / kNearest;
  };
  return in_front(coordinates[1]) && in_front(coordinates[3]) && std::abs(coordinates[0]) < kOffset &&
         std::abs(coordinates[2]) < kOffset;
}

LineEnds AnchoredLine::ends() const {
  const HomogeneousPoint a = end_a(), b = end_b();
  return {a.x / a.w, b.x / b.w};
}

// An end lies in the plane through the anchor's centre in which its offset moves it.
std::optional<Vec4> AnchoredLine::coordinates_of(const LineEnds& ends, const LineAnchor& anchor) {
  const Pose T_c_w = anchor.T_w_c.inverse();
  const Vec3 a = T_c_w * ends.a, b = T_c_w * ends.b, along = b - a;
  Vec4 out;
  for (int k = 0; k < 2; ++k) {
    const Vec2& m = k == 0 ? anchor.a : anchor.b;
    const Vec3 plane = Vec3(m.x(), m.y(), 1).cross(Vec3(anchor.normal.x(), anchor.normal.y(), 0));
    const double slope = plane.dot(along);
    if (std::abs(slope) < 1e-9 * along.norm()) return std::nullopt;
    const Vec3 end = a - plane.dot(a) / slope * along;
    if (!(end.z() > 0)) return std::nullopt;
    out.segment<2>(2 * k) << anchor.normal.dot(Vec2(end.head<2>() / end.z()) - m), 1 / end.z();
  }
  return out;
}

// Each end is moved with the world, seen from the anchor again, and slid along the line back to where only
// offset and inverse depth are free. In (x, y, inverse depth) a line is straight.
Eigen::Matrix4d AnchoredLine::world_moves() const {
  const Mat3 R_c_w = anchor.T_w_c.R().transpose();
  const double length = (anchor.b - anchor.a).norm();
  const Vec2 along = (anchor.b - anchor.a) / length;
  const double d_offset = (coordinates[2] - coordinates[0]) / length,
               d_inverse_depth = (coordinates[3] - coordinates[1]) / length;
  Eigen::Matrix4d out;
  for (int k = 0; k < 2; ++k) {
    const double offset = coordinates[2 * k], inverse_depth = coordinates[2 * k + 1];
    const Vec2 m = (k == 0 ? anchor.a : anchor.b) + offset * anchor.normal;
    const Vec3 scaled = end(k == 0 ? anchor.a : anchor.b, offset, inverse_depth).x;
    Mat34 moves;  // of the end in the camera, times its inverse depth
    moves << inverse_depth * R_c_w, R_c_w * Vec3::UnitZ().cross(scaled);
    for (int j = 0; j < 4; ++j) {
      const Vec2 dm = moves.col(j).head<2>() - m * moves(2, j);
      const double slide = along.dot(dm);
      out(2 * k, j) = anchor.normal.dot(dm) - slide * d_offset;
      out(2 * k + 1, j) = -inverse_depth * moves(2, j) - slide * d_inverse_depth;
    }
  }
  return out;
}

std::optional<Vec2> bin_distances(const LineBin& bin, double event_lag_px, const AnchoredLine& line,
                                  const TimedCamera& timed, const Camera& camera) {
  const auto image = ImageLine::through(timed.at(line.end_a()), timed.at(line.end_b()), camera);
  if (!image) return std::nullopt;
  return Vec2(image->signed_distance(bin.a(event_lag_px)), image->signed_distance(bin.b(event_lag_px)));
}

BinResidual bin_to_line(const LineBin& bin, double event_lag_px, const AnchoredLine& line,
                        const TimedCamera& timed, const Camera& camera) {
  BinResidual r;
  const HomogeneousPoint end_a = line.end_a(), end_b = line.end_b();
  const Vec3 a = timed.at(end_a), b = timed.at(end_b);
  const auto image = ImageLine::through(a, b, camera);
  if (!image) return r;
  const Vec3 from_a = timed.seen_from_start(end_a), from_b = timed.seen_from_start(end_b);
  const Mat3 R_w_c = line.anchor.T_w_c.R();
  // d point / d offset, d point / d inverse depth (and d w / d inverse depth = 1), in the camera.
  const Vec3 across =
      timed.R_c_w() * (R_w_c.col(0) * line.anchor.normal.x() + R_w_c.col(1) * line.anchor.normal.y());
  const Vec3 nearer = timed.R_c_w() * line.anchor.T_w_c.p + timed.d_x_d_w();
  for (int k = 0; k < 2; ++k) {
    const auto distance = image->distance(k == 0 ? bin.a(event_lag_px) : bin.b(event_lag_px));
    const Vec3 d_a = distance.d_a.transpose(), d_b = distance.d_b.transpose();
    const Vec3 d_a0 = timed.R_c_0().transpose() * d_a, d_b0 = timed.R_c_0().transpose() * d_b;
    r.value[k] = distance.value;
    r.d_camera.row(k) << (end_a.w * d_a0 + end_b.w * d_b0).transpose(),
        (d_a0.cross(from_a) + d_b0.cross(from_b)).transpose(),
        image->normal().dot(k == 0 ? bin.a_heading : bin.b_heading);
    r.d_line.row(k) << d_a.dot(across), d_a.dot(nearer), d_b.dot(across), d_b.dot(nearer);
    r.d_calibration.row(k) << (d_a.cross(a) + d_b.cross(b)).transpose(), distance.d_log_focal;
  }
  r.valid = true;
  return r;
}

}  // namespace idol
