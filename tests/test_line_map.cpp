// The archive of lines and the association with it.
#include <gtest/gtest.h>

#include <random>

#include "idol/map/associate.hpp"
#include "idol/map/line_map.hpp"

namespace idol::test {
namespace {

ArchivedLine archived(LineId id, const Vec3& middle, double distance) {
  ArchivedLine out;
  out.id = id;
  out.ends = {middle - Vec3(0.2, 0, 0), middle + Vec3(0.2, 0, 0)};
  out.distance_m = distance;
  return out;
}

TEST(LineMap, FindsLinesFromAsFarAsTheyWereSeen) {
  LineMap map;
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-50, 50);
  std::vector<ArchivedLine> lines;
  for (LineId id = 0; id < 3000; ++id) {
    lines.push_back(
        archived(id, Vec3(uniform(rng), uniform(rng), uniform(rng)), 0.3 + std::abs(uniform(rng)) / 5));
    map.insert(lines.back());
  }
  const Vec3 position(3, -2, 5);
  const auto found = map.near(position);
  EXPECT_TRUE(std::is_sorted(found.begin(), found.end(), [](auto* a, auto* b) { return a->id < b->id; }));
  std::size_t in_reach = 0;
  for (const ArchivedLine& line : lines) {
    const double distance = (0.5 * (line.ends.a + line.ends.b) - position).norm();
    const bool is_found =
        std::any_of(found.begin(), found.end(), [&](auto* other) { return other->id == line.id; });
    if (distance < 2 * line.distance_m) {  // two cells of at least that size
      EXPECT_TRUE(is_found) << line.id;
      ++in_reach;
    }
    if (distance > 12 * line.distance_m) {
      EXPECT_FALSE(is_found) << line.id;
    }
  }
  EXPECT_GT(in_reach, 5U);
  EXPECT_LT(found.size(), lines.size() / 4);
  for (const ArchivedLine& line : lines) map.erase(line.id);
  EXPECT_EQ(map.size(), 0U);
  EXPECT_TRUE(map.near(position).empty());
  EXPECT_EQ(map.find(3), nullptr);
}

struct Scene {
  Camera camera{240, 180, 200, 200, 120, 90};
  Pose truth{Quat(Eigen::AngleAxisd(-1.5, Vec3::UnitX())),
             Vec3(0.2, -0.1, 1.5)};  // looks along the world's y
  std::vector<MapSegment> lines;

  [[nodiscard]] std::vector<ImageSegment> seen_from(const Pose& estimate) const {
    std::vector<ImageSegment> out;
    for (const MapSegment& line : lines) {
      const Vec3 a = truth.inverse() * line.ends.a, b = truth.inverse() * line.ends.b;
      if (a.z() < 0.1 || b.z() < 0.1) continue;
      const Vec2 pa = camera.project(a), pb = camera.project(b);
      if (pa.x() < 0 || pa.x() > 240 || pa.y() < 0 || pa.y() > 180 || (pb - pa).norm() < 12) continue;
      out.push_back({1000 + line.id, pa, pb, estimate});
    }
    return out;
  }
};

Scene random_scene(unsigned seed, int lines) {
  Scene scene;
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (LineId id = 0; id < lines; ++id) {
    const Vec3 middle(2.5 * uniform(rng), 3 + uniform(rng), 1.5 + 1.5 * uniform(rng));
    const Vec3 half(0.4 * uniform(rng), 0.2 * uniform(rng), 0.4 * uniform(rng));
    scene.lines.push_back({id, {middle - half, middle + half}});
  }
  return scene;
}

Eigen::Matrix4d covariance(double position, double yaw) {
  return Eigen::Vector4d(position, position, position, yaw).cwiseAbs2().asDiagonal();
}

TEST(Associate, FindsTheOffsetAndThePairs) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    const Scene scene = random_scene(seed, 60);
    const MapOffset offset(0.1, -0.08, 0.05, 0.02);
    const Pose estimate{quat_exp(Vec3(0, 0, -offset[3])) * scene.truth.q, scene.truth.p - offset.head<3>()};
    const auto segments = scene.seen_from(estimate);
    ASSERT_GT(segments.size(), 12U);
    const auto found = associate(segments, scene.lines, scene.camera, covariance(0.12, 0.03));
    ASSERT_TRUE(found);
    EXPECT_LT((found->offset - offset).norm(), 0.04);
    std::size_t right = 0;
    for (const LineMatch& match : found->matches) right += match.segment == match.line + 1000 ? 1 : 0;
    EXPECT_GT(right, 0.8 * static_cast<double>(segments.size()));
    EXPECT_GT(right, 0.9 * static_cast<double>(found->matches.size()));
  }
}

TEST(Associate, FindsNothingInAnotherScene) {
  int accepted = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Scene scene = random_scene(seed, 60), other = random_scene(seed + 100, 60);
    accepted +=
        associate(scene.seen_from(scene.truth), other.lines, scene.camera, covariance(0.12, 0.03)) ? 1 : 0;
  }
  EXPECT_LE(accepted, 1);
}

// Equal posts, 25 cm apart: the offset may be off by as much, so either neighbour may be the one.
TEST(Associate, DoesNotChooseAmongEqualNeighbours) {
  Scene scene;
  for (LineId id = 0; id < 40; ++id) {
    const double x = 0.25 * static_cast<double>(id - 20);
    scene.lines.push_back({id, {Vec3(x, 3, 1), Vec3(x, 3, 2)}});
  }
  const Pose estimate{scene.truth.q, scene.truth.p + Vec3(0.1, 0, 0)};
  EXPECT_FALSE(associate(scene.seen_from(estimate), scene.lines, scene.camera, covariance(0.2, 0.02)));
  // Where the pose is known better than their distance there is no doubt.
  EXPECT_TRUE(associate(scene.seen_from(scene.truth), scene.lines, scene.camera, covariance(0.01, 0.002)));
}

}  // namespace
}  // namespace idol::test
