// Every analytic derivative against central differences, and Ceres' own checker on the wrapped costs.
#include "idol/backend/residuals.hpp"

#include <ceres/gradient_checker.h>

#include "idol/backend/costs.hpp"
#include "imu_motion.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

NavState perturbed(const NavState& s, const Eigen::VectorXd& d) {
  NavState out = s;
  out.T_w_i.p += d.segment<3>(0);
  out.T_w_i.q = s.T_w_i.q * quat_exp(d.segment<3>(3));
  out.v_w += d.segment<3>(6);
  out.bias.gyro += d.segment<3>(9);
  out.bias.accel += d.segment<3>(12);
  return out;
}

struct Setting {
  Projection projection;
  NavState state;
  ImuBias linearised_at;
  EventMeasurement event;
  LineEnds ends;
};

// A camera looking at a line two metres ahead, 40 ms after the window's begin.
Setting random_scene(unsigned seed, const Vec2& px) {
  std::mt19937 rng(seed);
  Setting s;
  s.projection.camera = {240, 180, 199, 198, 132, 110, Distortion::kNone, {}};
  s.projection.T_i_c = {quat_exp(test::random_vec3(rng, 0.2)), test::random_vec3(rng, 0.05)};
  const test::SineMotion motion{2.0};
  s.linearised_at = {Vec3(0.01, -0.01, 0.02), Vec3(0.1, 0.05, -0.1)};
  const auto samples = motion.readings(0.4, 0.7, 500, s.linearised_at);
  const Preintegration imu(samples, from_seconds(0.5), from_seconds(0.6), s.linearised_at, {}, {});
  s.event = {px, imu.at(from_seconds(0.54))};
  s.state = motion.state(0.5);
  s.state.bias = {s.linearised_at.gyro + test::random_vec3(rng, 0.01),
                  s.linearised_at.accel + test::random_vec3(rng, 0.1)};
  const Pose T_w_c =
      predict(s.state, s.event.motion, s.linearised_at, s.projection.gravity).T_w_i * s.projection.T_i_c;
  s.ends = {T_w_c * Vec3(-0.4, -0.2, 2.0), T_w_c * Vec3(0.5, 0.1, 2.5)};
  return s;
}

using Row = std::function<LineResidual(const Setting&, const PointInCamera&, const PointInCamera&)>;

void expect_line_jacobians(const Setting& scene, const Row& row, double tolerance) {
  const auto evaluate = [&](const NavState& state, const LineEnds& ends) {
    const auto a = TimedCamera(state, scene.event.motion, scene.linearised_at, scene.projection)({ends.a});
    const auto b = TimedCamera(state, scene.event.motion, scene.linearised_at, scene.projection)({ends.b});
    return row(scene, a, b);
  };
  const LineResidual r = evaluate(scene.state, scene.ends);
  ASSERT_TRUE(r.valid);
  const auto by_state = test::numeric_jacobian(
      [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
        return Eigen::VectorXd::Constant(1, evaluate(perturbed(scene.state, d), scene.ends).value);
      },
      15);
  const auto by_line = test::numeric_jacobian(
      [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
        return Eigen::VectorXd::Constant(
            1, evaluate(scene.state, {scene.ends.a + d.head<3>(), scene.ends.b + d.tail<3>()}).value);
      },
      6);
  test::expect_jacobian(r.d_state, by_state, tolerance);
  test::expect_jacobian(r.d_line, by_line, tolerance);
}

TEST(EventToLine, IsThePapersDistanceAndItsDerivative) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    const Setting s = random_scene(seed, Vec2(120, 90));
    expect_line_jacobians(
        s,
        [](const Setting& x, const auto& a, const auto& b) {
          return event_to_line(x.event, a, b, x.projection.camera);
        },
        1e-5);
    const auto a = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.a});
    const auto b = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.b});
    const Vec2 pa = s.projection.camera.project(a.x), pb = s.projection.camera.project(b.x);
    const Vec2 e = s.event.px - pa, l = pb - pa;
    const double papers = std::abs(e.x() * l.y() - e.y() * l.x()) / l.norm();
    EXPECT_NEAR(std::abs(event_to_line(s.event, a, b, s.projection.camera).value), papers, 1e-9);
  }
}

TEST(EventToLine, SurvivesAnEndBehindTheCameraAndRefusesADegenerateLine) {
  Setting s = random_scene(1, Vec2(120, 90));
  const Pose T_w_c =
      predict(s.state, s.event.motion, s.linearised_at, s.projection.gravity).T_w_i * s.projection.T_i_c;
  const Vec3 front = T_w_c * Vec3(0.1, 0.0, 2.0), direction = T_w_c.q * Vec3(0.3, 0.2, -1);
  const auto value = [&](double length) {
    const auto a = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({front});
    const auto b =
        TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({front + length * direction});
    return event_to_line(s.event, a, b, s.projection.camera);
  };
  EXPECT_NEAR(value(1).value, value(4).value, 1e-9);  // the same line, its end behind the camera
  EXPECT_FALSE(value(0).valid);
}

TEST(Repulsion, DerivativesOnBothSidesAndZeroInside) {
  const auto row = [](const Setting& x, const auto& a, const auto& b) {
    return repulsion(x.event, a, b, x.projection.camera);
  };
  for (unsigned seed = 0; seed < 5; ++seed) {
    for (const Vec2& px : {Vec2(20, 70), Vec2(230, 130)})
      expect_line_jacobians(random_scene(seed, px), row, 2e-5);
  }
  const Setting s = random_scene(3, Vec2(130, 100));
  const auto a = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.a});
  const auto b = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.b});
  EXPECT_EQ(row(s, a, b).value, 0);
}

TEST(Attraction, IsTheRootOfTheProjectedLength) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Setting s = random_scene(seed, Vec2(120, 90));
    expect_line_jacobians(
        s, [](const Setting& x, const auto& a, const auto& b) { return attraction(a, b, x.projection.camera); },
        1e-6);
  }
}

TEST(ImuResidual, IsZeroAtThePredictionAndDifferentiatesRight) {
  std::mt19937 rng(7);
  const Setting s = random_scene(2, Vec2(0, 0));
  const Vec3 g = s.projection.gravity;
  const NavState exact = predict(s.state, s.event.motion, s.linearised_at, g);
  EXPECT_LT(imu_residual(s.state, exact, s.event.motion, s.linearised_at, g).value.norm(), 1e-12);
  Eigen::VectorXd d(15);
  for (auto& x : d) x = 0.1 * std::normal_distribution<double>()(rng);
  const NavState to = perturbed(exact, d);
  const ImuResidual r = imu_residual(s.state, to, s.event.motion, s.linearised_at, g);
  const auto value = [&](const NavState& a, const NavState& b) -> Eigen::VectorXd {
    return imu_residual(a, b, s.event.motion, s.linearised_at, g).value;
  };
  test::expect_jacobian(
      r.d_from, test::numeric_jacobian([&](const auto& x) { return value(perturbed(s.state, x), to); }, 15),
      1e-6);
  test::expect_jacobian(
      r.d_to, test::numeric_jacobian([&](const auto& x) { return value(s.state, perturbed(to, x)); }, 15),
      1e-6);
}

// Position, yaw of the world: nothing the estimator measures may depend on them.
TEST(Residuals, AreBlindToTheFourUnobservableDirections) {
  const Setting s = random_scene(4, Vec2(120, 90));
  const auto a = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.a});
  const auto b = TimedCamera(s.state, s.event.motion, s.linearised_at, s.projection)({s.ends.b});
  const LineResidual line = event_to_line(s.event, a, b, s.projection.camera);
  const NavState next = predict(s.state, s.event.motion, s.linearised_at, s.projection.gravity);
  const ImuResidual imu = imu_residual(s.state, next, s.event.motion, s.linearised_at, s.projection.gravity);
  const auto state_direction = [](const NavState& x, int k) {
    Eigen::Matrix<double, 15, 1> d = Eigen::Matrix<double, 15, 1>::Zero();
    if (k < 3) {
      d[k] = 1;
    } else {
      d << Vec3::UnitZ().cross(x.T_w_i.p), x.T_w_i.q.conjugate() * Vec3::UnitZ(), Vec3::UnitZ().cross(x.v_w),
          Eigen::Matrix<double, 6, 1>::Zero();
    }
    return d;
  };
  for (int k = 0; k < 4; ++k) {
    Eigen::Matrix<double, 6, 1> ends = Eigen::Matrix<double, 6, 1>::Zero();
    if (k < 3) {
      ends[k] = ends[k + 3] = 1;
    } else {
      ends << Vec3::UnitZ().cross(s.ends.a), Vec3::UnitZ().cross(s.ends.b);
    }
    EXPECT_NEAR((line.d_state * state_direction(s.state, k) + line.d_line * ends)(0), 0, 1e-9);
    EXPECT_LT((imu.d_from * state_direction(s.state, k) + imu.d_to * state_direction(next, k)).norm(), 1e-9);
  }
}

void expect_gradients(const ceres::CostFunction& cost, std::vector<std::vector<double>> blocks,
                      const std::vector<const ceres::Manifold*>& manifolds) {
  ceres::NumericDiffOptions options;
  // Small steps: Huber's loss and the line's ends have kinks that the default step of 1e-2 jumps over.
  options.ridders_relative_initial_step_size = 1e-4;
  std::vector<const double*> parameters;
  for (const auto& block : blocks) parameters.push_back(block.data());
  ceres::GradientChecker checker(&cost, &manifolds, options);
  ceres::GradientChecker::ProbeResults results;
  checker.Probe(parameters.data(), 1e-4, &results);
  // The checker's own verdict is relative even for entries that are zero: compare with a floor instead.
  ASSERT_TRUE(results.return_value);
  ASSERT_EQ(results.local_jacobians.size(), blocks.size());
  for (std::size_t k = 0; k < blocks.size(); ++k)
    test::expect_jacobian(results.local_jacobians[k], results.local_numeric_jacobians[k],
                          1e-6 * (1 + results.local_jacobians[k].cwiseAbs().maxCoeff()));
}

std::vector<double> values(const Eigen::VectorXd& v) { return {v.begin(), v.end()}; }

TEST(Costs, PassCeresGradientChecker) {
  const PoseManifold pose_manifold;
  const TiltManifold tilt_manifold;
  const Setting s = random_scene(6, Vec2(25, 70));
  const StateParameters from = to_parameters(s.state);
  NavState next = predict(s.state, s.event.motion, s.linearised_at, s.projection.gravity);
  next.T_w_i.p += Vec3(0.01, 0.02, -0.01);
  const StateParameters to = to_parameters(next);
  Eigen::VectorXd ends(6);
  ends << s.ends.a, s.ends.b;
  const std::vector<EventMeasurement> events = {
      s.event, {Vec2(120, 95), s.event.motion}, {Vec2(235, 140), s.event.motion}};
  const LineNoise noise;
  for (const ceres::Manifold* manifold : {static_cast<const ceres::Manifold*>(&pose_manifold),
                                          static_cast<const ceres::Manifold*>(&tilt_manifold)}) {
    expect_gradients(*event_line_cost(events, s.linearised_at, s.projection, noise),
                     {values(from.pose), values(from.motion), values(ends)}, {manifold, nullptr, nullptr});
    expect_gradients(*attraction_cost(s.event.motion, s.linearised_at, s.projection, noise),
                     {values(from.pose), values(from.motion), values(ends)}, {manifold, nullptr, nullptr});
    expect_gradients(
        *imu_cost(s.event.motion, 1e-4 * Mat9::Identity(), s.linearised_at, s.projection.gravity),
        {values(from.pose), values(from.motion), values(to.pose), values(to.motion)},
        {manifold, nullptr, manifold, nullptr});
  }
  expect_gradients(*bias_walk_cost({}, 0.05), {values(from.motion), values(to.motion)}, {nullptr, nullptr});
  expect_gradients(*depth_prior_cost(s.state.T_w_i, 1.5, 1.0, 0.5), {values(ends)}, {nullptr});
  expect_gradients(
      *motion_prior_cost(Eigen::Matrix<double, 9, 1>::Zero(), Eigen::Matrix<double, 9, 1>::Constant(0.1)),
      {values(from.motion)}, {nullptr});
}

TEST(Manifolds, PlusAndMinusAreInverse) {
  std::mt19937 rng(9);
  const StateParameters x = to_parameters(random_scene(8, Vec2(0, 0)).state);
  const auto check = [&](const ceres::Manifold& manifold) {
    Eigen::VectorXd delta(manifold.TangentSize()), back(manifold.TangentSize()), y(kPoseSize);
    for (auto& d : delta) d = 0.3 * std::normal_distribution<double>()(rng);
    manifold.Plus(x.pose.data(), delta.data(), y.data());
    manifold.Minus(y.data(), x.pose.data(), back.data());
    EXPECT_LT((delta - back).norm(), 1e-12);
  };
  check(PoseManifold());
  check(TiltManifold());
  // The gauge keeps position and yaw: the world's vertical axis may tilt, nothing turns about it.
  const TiltManifold tilt;
  Eigen::Matrix<double, 7, 1> y;
  const double small[2] = {1e-4, -2e-4};
  tilt.Plus(x.pose.data(), small, y.data());
  EXPECT_EQ(y.head<3>(), x.pose.head<3>());
  const Vec3 turn =
      quat_log(Quat(Eigen::Vector4d(y.tail<4>())) * Quat(Eigen::Vector4d(x.pose.tail<4>())).conjugate());
  EXPECT_NEAR(turn.z(), 0, 1e-12);
}

}  // namespace
}  // namespace idol
