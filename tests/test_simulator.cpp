#include <gtest/gtest.h>

#include <cmath>

#include "idol/base/diagnostics.hpp"
#include "idol/sim/renderer.hpp"
#include "idol/sim/simulator.hpp"
#include "idol/sim/spline.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

Rig small_rig() {
  Rig rig;
  rig.camera = {120, 90, 100, 100, 60, 45, Distortion::kRadTan, {-0.2, 0.05, 0, 0, 0}};
  rig.T_i_c = {quat_exp(Vec3(0.02, -0.03, 0.01)), Vec3(0.01, 0.02, 0.03)};
  rig.imu.rate_hz = 500;
  return rig;
}

SimulatorOptions ideal() {
  SimulatorOptions options;
  options.contrast_mismatch = options.jitter_s = options.background_hz = options.imu_noise_scale = 0;
  options.hot_pixels = 0;
  options.bias = {};
  return options;
}

// A dark bar from y = 0.15 to y = -0.15 before a light wall, seen along +x; the camera's x axis is the
// world's -y.
Scene one_bar() {
  Scene scene;
  scene.shapes.push_back(make_shape({{2, 0.15, -2}, {2, 0.15, 2}, {2, -0.15, 2}, {2, -0.15, -2}}, 0.1));
  return scene;
}

HandMotion lively(double duration_s) {
  HandMotion motion;
  motion.duration_s = duration_s;
  motion.still_s = 0;
  motion.seed = 5;
  return motion;
}

// Control poses on a straight line: constant velocity, no rotation.
Spline sideways(double speed, double duration_s, const Pose& start) {
  std::vector<Pose> control;
  for (int k = -1; 0.02 * k < duration_s + 0.05; ++k)
    control.push_back({start.q, start.p + 0.02 * k * speed * Vec3::UnitY()});
  return Spline(std::move(control), 0.02);
}

TEST(Spline, DerivativesMatchDifferences) {
  const Spline motion = hand_motion({quat_exp(Vec3(0.3, -0.2, 1.0)), Vec3(1, 2, 3)}, lively(3));
  constexpr double kStep = 1e-5;
  for (double t : {0.31, 0.777, 1.5, 2.2001, 2.9}) {
    const Kinematics before = motion.at(t - kStep), now = motion.at(t), after = motion.at(t + kStep);
    EXPECT_LT(((after.T_w_i.p - before.T_w_i.p) / (2 * kStep) - now.velocity_w).norm(), 1e-6);
    EXPECT_LT(((after.velocity_w - before.velocity_w) / (2 * kStep) - now.acceleration_w).norm(), 1e-4);
    const Vec3 rate = quat_log(before.T_w_i.q.conjugate() * after.T_w_i.q) / (2 * kStep);
    EXPECT_LT((rate - now.rate_i).norm(), 1e-6);
  }
}

TEST(Spline, FollowsATrajectoryOfTheCamera) {
  const Rig rig = small_rig();
  Trajectory camera;
  for (int k = 0; k <= 400; ++k) {
    const double t = 0.01 * k;
    camera.push_back(
        {from_seconds(100 + t), {quat_exp(Vec3(0, 0, 0.2 * std::sin(t))), Vec3(0.3 * std::sin(t), 0, 0)}});
  }
  const Spline motion = spline_from_trajectory(camera, rig.T_i_c, 1.0);
  EXPECT_NEAR(motion.duration(), 4, 0.1);
  double nearest = 1;
  const Vec3 at_two = (motion.at(2.0).T_w_i * rig.T_i_c).p;
  for (const auto& pose : camera) nearest = std::min(nearest, (pose.T.p - at_two).norm());
  EXPECT_LT(nearest, 2e-3);
  EXPECT_THROW(spline_from_trajectory({}, rig.T_i_c, 1.0), DataError);
}

TEST(Simulator, ImuReadingsIntegrateToTheTruth) {
  const Rig rig = small_rig();
  const Spline motion = hand_motion({}, lively(2));
  const auto data = simulate_in_memory(Scene{}, motion, rig, ideal());
  ASSERT_EQ(data.truth.front().t, 0);
  Pose pose = data.truth.front().T_w_i;
  Vec3 v = data.truth.front().v_w;
  const double dt = 1 / rig.imu.rate_hz;
  for (std::size_t k = 0; k + 1 < data.imu.size(); ++k) {  // midpoint rule
    const Vec3 rate = 0.5 * (data.imu[k].gyro + data.imu[k + 1].gyro);
    const Quat next = pose.q * quat_exp(rate * dt);
    const Vec3 a = 0.5 * (pose.q * data.imu[k].accel + next * data.imu[k + 1].accel) - Vec3(0, 0, 9.81);
    pose.p += v * dt + 0.5 * a * dt * dt;
    v += a * dt;
    pose.q = next;
  }
  const Kinematics truth = motion.at(seconds_between(data.imu.front().t, data.imu.back().t));
  EXPECT_LT((pose.p - truth.T_w_i.p).norm(), 1e-3);
  EXPECT_LT((v - truth.velocity_w).norm(), 1e-3);
  EXPECT_LT(quat_log(pose.q.conjugate() * truth.T_w_i.q).norm(), 1e-4);
}

TEST(Simulator, NoiseHasTheRigsDensityAndBiasesAreAdded) {
  Rig rig = small_rig();
  SimulatorOptions options = ideal();
  options.imu_noise_scale = 1;
  options.bias = {Vec3(0.01, -0.02, 0.03), Vec3(0.1, 0.2, -0.3)};
  rig.imu.gyro_walk = rig.imu.accel_walk = 0;
  const auto data = simulate_in_memory(Scene{}, sideways(0, 4, {}), rig, options);
  Vec3 mean = Vec3::Zero(), square = Vec3::Zero();
  for (const auto& s : data.imu) mean += s.gyro / static_cast<double>(data.imu.size());
  for (const auto& s : data.imu) square += (s.gyro - mean).cwiseAbs2() / static_cast<double>(data.imu.size());
  const double sigma = rig.imu.gyro_density * std::sqrt(rig.imu.rate_hz);
  EXPECT_LT((mean - options.bias.gyro).norm(), 5 * sigma / std::sqrt(static_cast<double>(data.imu.size())));
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(std::sqrt(square[i]), sigma, 0.1 * sigma);
}

TEST(Simulator, EventsLieOnTheMovingEdgesWithTheirPolarity) {
  const Rig rig = small_rig();
  const Scene scene = one_bar();
  const Pose start = starting_camera(scene) * rig.T_i_c.inverse();
  const Spline motion = sideways(0.5, 0.6, start);
  const auto data = simulate_in_memory(scene, motion, rig, ideal());
  ASSERT_GT(data.events.size(), 1000U);
  const UndistortMap undistort(rig.camera);
  for (const Event& e : data.events) {
    const Pose T_c_w = (motion.at(static_cast<double>(e.t) / kNsPerS).T_w_i * rig.T_i_c).inverse();
    const Vec2 px = undistort(e.x, e.y).cast<double>();
    double distance[2];
    for (int side = 0; side < 2; ++side) {
      const double y = side == 0 ? 0.15 : -0.15;
      const Vec2 a = rig.camera.project(T_c_w * Vec3(2, y, -1)),
                 b = rig.camera.project(T_c_w * Vec3(2, y, 1));
      const Vec2 along = (b - a).normalized();
      distance[side] = std::abs(along.x() * (px - a).y() - along.y() * (px - a).x());
    }
    const int nearest = distance[0] < distance[1] ? 0 : 1;
    ASSERT_LT(distance[nearest], 0.75);
    // The camera moves towards +y, its left: the bar's left edge darkens the wall, its right edge gives it
    // back.
    ASSERT_EQ(e.polarity, nearest == 0 ? true : false) << "side " << nearest;
  }
  for (std::size_t k = 1; k < data.events.size(); ++k) ASSERT_LE(data.events[k - 1].t, data.events[k].t);
}

TEST(Simulator, SameSeedSameBitsAndAnotherSeedOtherEvents) {
  const Rig rig = small_rig();
  const Scene scene = one_bar();
  SimulatorOptions options;
  const auto run = [&](std::uint64_t seed) {
    options.seed = seed;
    return simulate_in_memory(scene, hand_motion(starting_camera(scene) * rig.T_i_c.inverse(), lively(0.5)),
                              rig, options);
  };
  const auto a = run(1), b = run(1), c = run(2);
  const auto same = [](const Event& x, const Event& y) {
    return x.t == y.t && x.x == y.x && x.y == y.y && x.polarity == y.polarity;
  };
  ASSERT_FALSE(a.events.empty());
  EXPECT_TRUE(std::equal(a.events.begin(), a.events.end(), b.events.begin(), b.events.end(), same));
  EXPECT_FALSE(std::equal(a.events.begin(), a.events.end(), c.events.begin(), c.events.end(), same));
  for (std::size_t k = 0; k < a.imu.size(); ++k) ASSERT_EQ(a.imu[k].gyro, b.imu[k].gyro);
}

TEST(Simulator, AnEmptySceneGivesOnlyNoise) {
  const Rig rig = small_rig();
  EXPECT_TRUE(simulate_in_memory(Scene{}, hand_motion({}, lively(1)), rig, ideal()).events.empty());
  SimulatorOptions options = ideal();
  options.background_hz = 1;
  const auto noisy = simulate_in_memory(Scene{}, hand_motion({}, lively(1)), rig, options);
  const double expected = rig.camera.width * rig.camera.height;
  EXPECT_NEAR(static_cast<double>(noisy.events.size()), expected, 5 * std::sqrt(expected));
}

TEST(Renderer, CoverageOfAnEdgePixelIsItsShare) {
  Rig rig = small_rig();
  rig.camera.distortion = Distortion::kNone;
  Scene scene;
  scene.background = 0.9;
  // Right of u = 60.25 (normalised x = 0.0025) everything is dark; the camera looks along +z.
  scene.shapes.push_back(make_shape({{0.0025, -1, 1}, {0.0025, 1, 1}, {2, 1, 1}, {2, -1, 1}}, 0.1));
  Renderer renderer(scene, rig.camera);
  const auto& image = renderer.render(Pose());
  const std::size_t row = 45 * 120;
  EXPECT_FLOAT_EQ(image[row + 59], 0.9F);
  EXPECT_NEAR(image[row + 60], 0.75 * 0.9 + 0.25 * 0.1, 1e-5);
  EXPECT_FLOAT_EQ(image[row + 61], 0.1F);
}

TEST(Scene, BadShapesAreRefusedWithTheirLine) {
  const TempDir dir;
  const auto message = [&](const std::string& text) {
    try {
      load_scene(dir.write("scene.yaml", text));
    } catch (const DataError& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_NE(message("background: 0.5\n").find("no 'shapes'"), std::string::npos);
  EXPECT_NE(message("shapes:\n  - polygon: [[0,0,0],[1,0,0]]\n").find("scene.yaml:2"), std::string::npos);
  EXPECT_NE(message("shapes:\n  - polygon: [[0,0,0],[1,0,0],[1,1,0],[0,1,1]]\n").find("one plane"),
            std::string::npos);
  EXPECT_NE(message("shapes:\n  - circle: 1\n").find("scene.yaml:2"), std::string::npos);
  EXPECT_NE(message("shapes: [").find("scene.yaml:1"), std::string::npos);
  EXPECT_THROW(load_scene(dir.path() / "none.yaml"), DataError);
}

TEST(Scene, PiecesTileTheOutlineOfAConcaveShape) {
  const Shape star = make_shape({{0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {1, 1, 0}, {1, 2, 0}, {0, 2, 0}}, 0.2);
  double area = 0;
  for (const auto& piece : star.pieces) {
    ASSERT_EQ(piece.size(), 3U);
    area += 0.5 * (piece[1] - piece[0]).cross(piece[2] - piece[0]).norm();
  }
  EXPECT_NEAR(area, 3, 1e-9);
}

}  // namespace
}  // namespace idol::test
