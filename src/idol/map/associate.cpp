#include "idol/map/associate.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <set>

namespace idol {
namespace {

using Jacobian = Eigen::Matrix<double, 2, 4>;

constexpr double kSigmaPx = 1.0;   // of a segment's end across the line: its own error, tilt and calibration
constexpr double kInlierPx = 2.5;  // 2.5 sigma
constexpr double kNearest = 0.05;  // [m] in front of the camera
constexpr double kGate = 13.8;     // chi-square of two degrees of freedom, 99.9 %
constexpr int kFewest = 6;         // matches: four unknowns leave eight of twelve numbers to contradict
constexpr double kSecondBest = 0.6;  // share of the matches that a contradicting offset may have
constexpr std::size_t kMostHypotheses = 400;

struct Pair {
  std::size_t segment = 0, line = 0;
  Vec2 distance = Vec2::Zero();  // of the segment's ends from the line's image [px]
  Jacobian by_offset = Jacobian::Zero();
};

Pose moved(const Pose& T_w_c, const MapOffset& offset) {
  return {quat_exp(Vec3(0, 0, offset[3])) * T_w_c.q, T_w_c.p + offset.head<3>()};
}

// The part of a segment in the camera's frame that is in front of it.
std::optional<LineEnds> in_front(const LineEnds& ends) {
  LineEnds out = ends;
  if (out.a.z() < kNearest && out.b.z() < kNearest) return std::nullopt;
  const auto clip = [](Vec3& behind, const Vec3& before) {
    behind = before + (behind - before) * (before.z() - kNearest) / (before.z() - behind.z());
  };
  if (out.a.z() < kNearest) clip(out.a, out.b);
  if (out.b.z() < kNearest) clip(out.b, out.a);
  return out;
}

// Whether at least half of the shorter lies beside the other, `slack` pixels more or less.
bool overlap(const ImageSegment& segment, const Vec2& a, const Vec2& b, double slack) {
  const double length = (b - a).norm();
  if (length < 1e-6) return false;
  const Vec2 along = (b - a) / length;
  const double u = along.dot(segment.a - a), v = along.dot(segment.b - a);
  const double common = std::min(std::max(u, v), length) - std::max(std::min(u, v), 0.0);
  return common + slack > 0.5 * std::min(std::abs(u - v), length);
}

std::optional<Pair> compare(const ImageSegment& segment, const MapSegment& line, const Pose& T_w_c,
                            const Camera& camera, double slack) {
  const Pose T_c_w = T_w_c.inverse();
  const auto visible = in_front({T_c_w * line.ends.a, T_c_w * line.ends.b});
  if (!visible || !overlap(segment, camera.project(visible->a), camera.project(visible->b), slack))
    return std::nullopt;
  const auto image = ImageLine::through(visible->a, visible->b, camera);
  if (!image) return std::nullopt;
  Pair out;
  const Mat3 R_c_w = T_c_w.R();
  // x_c = R_c_w (x_w - p): a shift of the camera moves points back, a turn about the vertical turns them
  // back.
  const auto by_offset = [&](const Vec3& x_c) {
    Eigen::Matrix<double, 3, 4> d;
    d << -R_c_w, -R_c_w * Vec3::UnitZ().cross(R_c_w.transpose() * x_c);
    return d;
  };
  for (int k = 0; k < 2; ++k) {
    const auto distance = image->distance(k == 0 ? segment.a : segment.b);
    out.distance[k] = distance.value;
    out.by_offset.row(k) = distance.d_a * by_offset(visible->a) + distance.d_b * by_offset(visible->b);
  }
  return out;
}

// All pairs that the offset's covariance allows.
std::vector<Pair> candidates(std::span<const ImageSegment> segments, std::span<const MapSegment> lines,
                             const Camera& camera, const Eigen::Matrix4d& covariance) {
  std::vector<Pair> out;
  for (std::size_t l = 0; l < lines.size(); ++l)
    for (std::size_t s = 0; s < segments.size(); ++s) {
      const double length = (segments[s].b - segments[s].a).norm();
      auto pair = compare(segments[s], lines[l], segments[s].T_w_c, camera, 0.5 * length);
      if (!pair) continue;
      const Eigen::Matrix2d S = pair->by_offset * covariance * pair->by_offset.transpose() +
                                kSigmaPx * kSigmaPx * Eigen::Matrix2d::Identity();
      if (pair->distance.dot(S.inverse() * pair->distance) > kGate) continue;
      pair->segment = s;
      pair->line = l;
      out.push_back(*pair);
    }
  return out;
}

// Of each of the segments the pair that fits best under an offset, indices into `pairs`.
std::vector<std::size_t> inliers(const std::vector<Pair>& pairs, std::size_t segments,
                                 const MapOffset& offset) {
  std::vector<std::size_t> best(segments, pairs.size());
  std::vector<double> nearest(segments, kInlierPx);
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const double d = (pairs[k].distance + pairs[k].by_offset * offset).cwiseAbs().maxCoeff();
    const std::size_t s = pairs[k].segment;
    if (d > nearest[s] || (d == nearest[s] && best[s] < pairs.size())) continue;
    nearest[s] = d;
    best[s] = k;
  }
  std::erase(best, pairs.size());
  return best;
}

// Different lines of the map among the pairs: pieces of one line say little more than one.
int support(const std::vector<Pair>& pairs, const std::vector<std::size_t>& chosen) {
  std::set<std::size_t> lines;
  for (const std::size_t k : chosen) lines.insert(pairs[k].line);
  return static_cast<int>(lines.size());
}

// Most probable offset, by its prior and the chosen pairs.
MapOffset solve(const std::vector<Pair>& pairs, std::span<const std::size_t> chosen,
                const Eigen::Matrix4d& information) {
  Eigen::Matrix4d H = information;
  MapOffset g = MapOffset::Zero();
  for (const std::size_t k : chosen) {
    H += pairs[k].by_offset.transpose() * pairs[k].by_offset / (kSigmaPx * kSigmaPx);
    g += pairs[k].by_offset.transpose() * pairs[k].distance / (kSigmaPx * kSigmaPx);
  }
  return H.ldlt().solve(-g);
}

// Whether two offsets put most of the chosen lines at different places in the image.
bool contradict(const std::vector<Pair>& pairs, const std::vector<std::size_t>& chosen,
                const MapOffset& difference) {
  std::size_t apart = 0;
  for (const std::size_t k : chosen)
    apart += (pairs[k].by_offset * difference).cwiseAbs().maxCoeff() > 2 * kInlierPx ? 1 : 0;
  return 2 * apart > chosen.size();
}

}  // namespace

std::optional<Association> associate(std::span<const ImageSegment> segments,
                                     std::span<const MapSegment> lines, const Camera& camera,
                                     const Eigen::Matrix4d& covariance) {
  const std::vector<Pair> pairs = candidates(segments, lines, camera, covariance);
  const Eigen::Matrix4d information = covariance.inverse();
  if (std::ssize(pairs) < kFewest) return std::nullopt;
  std::vector<std::pair<int, MapOffset>> hypotheses{{0, MapOffset::Zero()}};
  // Two pairs fix most of an offset; of all twos a fixed number, spread evenly.
  const std::size_t twos = pairs.size() * (pairs.size() - 1) / 2,
                    step = std::max<std::size_t>(1, twos / kMostHypotheses);
  std::size_t count = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i)
    for (std::size_t j = i + 1; j < pairs.size(); ++j) {
      if (count++ % step != 0 || pairs[i].segment == pairs[j].segment || pairs[i].line == pairs[j].line)
        continue;
      const std::size_t two[] = {i, j};
      hypotheses.emplace_back(0, solve(pairs, two, information));
    }
  std::size_t best = 0;
  for (std::size_t h = 0; h < hypotheses.size(); ++h) {
    hypotheses[h].first = support(pairs, inliers(pairs, segments.size(), hypotheses[h].second));
    if (hypotheses[h].first > hypotheses[best].first) best = h;
  }
  Association out;
  out.offset = hypotheses[best].second;
  std::vector<std::size_t> chosen;
  for (int round = 0; round < 3; ++round) {
    chosen = inliers(pairs, segments.size(), out.offset);
    out.offset = solve(pairs, chosen, information);
  }
  // At that offset itself, not to first order.
  std::erase_if(chosen, [&](std::size_t k) {
    const ImageSegment& segment = segments[pairs[k].segment];
    const auto exact =
        compare(segment, lines[pairs[k].line], moved(segment.T_w_c, out.offset), camera, kInlierPx);
    return !exact || exact->distance.cwiseAbs().maxCoeff() > kInlierPx;
  });
  const int matches = support(pairs, chosen);
  for (const auto& [number, offset] : hypotheses)
    if (number > out.runner_up && contradict(pairs, chosen, offset - out.offset)) out.runner_up = number;
  if (matches < kFewest || out.runner_up > kSecondBest * matches) return std::nullopt;
  for (const std::size_t k : chosen)
    out.matches.push_back({segments[pairs[k].segment].id, lines[pairs[k].line].id});
  return out;
}

bool may_be_in_sight(const LineEnds& ends, const Pose& T_w_c, const Camera& camera) {
  const Pose T_c_w = T_w_c.inverse();
  const auto visible = in_front({T_c_w * ends.a, T_c_w * ends.b});
  if (!visible) return false;
  const Vec2 a = camera.project(visible->a), b = camera.project(visible->b);
  const auto reaches = [](double u, double v, double size) {
    return std::max(u, v) > -0.5 * size && std::min(u, v) < 1.5 * size;
  };
  return reaches(a.x(), b.x(), camera.width) && reaches(a.y(), b.y(), camera.height);
}

}  // namespace idol
