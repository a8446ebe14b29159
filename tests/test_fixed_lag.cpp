// The parts of the fixed-lag estimator: compression, minimal lines, the chain's algebra.
#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "idol/backend/anchored_line.hpp"
#include "idol/backend/backend.hpp"
#include "idol/backend/chain_system.hpp"
#include "idol/backend/dense.hpp"
#include "idol/backend/line_moments.hpp"
#include "idol/sim/spline.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

// Sum of squared distances of points from the line n.x + c = 0.
double cost(const std::vector<Vec2>& points, const Vec2& n, double c) {
  double sum = 0;
  for (const Vec2& p : points) sum += std::pow(n.dot(p) + c, 2);
  return sum;
}

TEST(LineMoments, TwoPointsCostWhatAllPointsCost) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> along(-30, 30);
  std::normal_distribution<double> noise(0, 0.4);
  for (double scatter : {0.0, 1.0}) {
    std::vector<Vec2> points;
    const Vec2 direction(std::cos(0.7), std::sin(0.7)), normal(-direction.y(), direction.x());
    for (int i = 0; i < 200; ++i)
      points.push_back(Vec2(100, 60) + along(rng) * direction + scatter * noise(rng) * normal);
    const LineMoments moments = compress(points);
    EXPECT_EQ(moments.count, 200);
    const std::vector<Vec2> two{moments.a(), moments.b()};
    for (double turn : {0.0, 0.02, -0.1}) {
      const Vec2 n(-std::sin(0.7 + turn), std::cos(0.7 + turn));
      const double c = -n.dot(Vec2(101, 59.5));
      // sum d^2 = N/2 (d_a^2 + d_b^2) + the scatter's own share, which hardly depends on the line.
      const double own = 200 * moments.across_px * moments.across_px *
                         std::pow(n.dot(Vec2(-moments.axis.y(), moments.axis.x())), 2);
      EXPECT_NEAR(100 * cost(two, n, c) + own, cost(points, n, c), 1e-8 * (1 + cost(points, n, c)));
    }
  }
  EXPECT_EQ(compress({}).count, 0);
}

struct Sight {
  Projection projection;
  NavState state;
  Preintegrated motion;
  ImuBias linearised_at;
  AnchoredLine line;
  Vec2 a{100, 60}, b{140, 75};
};

Sight some_sight() {
  Sight s;
  s.projection = {{240, 180, 200, 201, 120, 90},
                  {quat_exp(Vec3(0.1, -0.2, 0.3)), Vec3(0.02, -0.01, 0.04)},
                  Vec3(0, 0, -9.81)};
  s.state.T_w_i = {quat_exp(Vec3(0.3, 0.2, -0.4)), Vec3(0.5, -0.3, 0.2)};
  s.state.v_w = Vec3(0.3, -0.2, 0.1);
  s.state.bias = {Vec3(0.01, -0.02, 0.015), Vec3(0.05, -0.1, 0.02)};
  s.linearised_at = {Vec3(0.012, -0.018, 0.011), Vec3(0.04, -0.12, 0.03)};
  s.motion.dt = 0.03;
  s.motion.dR = so3_exp(Vec3(0.02, -0.03, 0.01));
  s.motion.dv = Vec3(0.1, 0.2, 0.3);
  s.motion.dp = Vec3(0.001, 0.003, 0.004);
  s.motion.rate = Vec3(0.5, -0.8, 0.3);
  s.motion.accel = Vec3(1, -2, 9);
  s.motion.d_R_d_bg = -0.03 * Mat3::Identity();
  s.motion.d_v_d_bg = 0.001 * hat(Vec3(1, 2, 3));
  s.motion.d_v_d_ba = -0.03 * Mat3::Identity();
  s.motion.d_p_d_bg = 1e-5 * hat(Vec3(1, 2, 3));
  s.motion.d_p_d_ba = -4.5e-4 * Mat3::Identity();
  const Pose T_w_c = s.state.T_w_i * s.projection.T_i_c;
  s.line.anchor =
      LineAnchor::from_image({T_w_c.q * quat_exp(Vec3(0.02, 0.05, 0.01)), T_w_c.p + Vec3(0.1, 0.05, -0.1)},
                             {90, 50}, {150, 80}, s.projection.camera);
  s.line.coordinates = Vec4(0.003, 0.6, -0.002, 0.4);
  return s;
}

BinResidual evaluate(const Sight& s, const NavState& state, const AnchoredLine& line) {
  return bin_to_line({s.a, s.b, Vec2(0.3, -0.9), Vec2(0.2, 0.8)}, state.event_lag_px, line,
                     TimedCamera(state, later(s.motion, state.time_shift), s.linearised_at, s.projection),
                     s.projection.camera);
}

Eigen::Matrix<double, 2, kStateDim> d_state(const Sight& s, const BinResidual& r) {
  Eigen::Matrix<double, 2, kStateDim> out;
  out << r.d_camera.leftCols<6>() *
             TimedCamera(s.state, later(s.motion, s.state.time_shift), s.linearised_at, s.projection)
                 .by_state(),
      r.d_camera.col(6);
  return out;
}

TEST(AnchoredLine, JacobiansMatchDifferences) {
  const Sight s = some_sight();
  const BinResidual r = evaluate(s, s.state, s.line);
  ASSERT_TRUE(r.valid);
  const LineBin bin{s.a, s.b, Vec2(0.3, -0.9), Vec2(0.2, 0.8)};
  const auto alone =
      bin_distances(bin, s.state.event_lag_px, s.line,
                    TimedCamera(s.state, later(s.motion, s.state.time_shift), s.linearised_at, s.projection),
                    s.projection.camera);
  ASSERT_TRUE(alone);
  EXPECT_LT((*alone - r.value).norm(), 1e-12);
  const auto by_state = numeric_jacobian(
      [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
        NavState moved = s.state;
        moved.T_w_i.p += d.head<3>();
        moved.T_w_i.q = moved.T_w_i.q * quat_exp(d.segment<3>(3));
        moved.v_w += d.segment<3>(6);
        moved.bias.gyro += d.segment<3>(9);
        moved.bias.accel += d.segment<3>(12);
        moved.time_shift += d[15];
        moved.event_lag_px += d[16];
        return evaluate(s, moved, s.line).value;
      },
      kStateDim);
  expect_jacobian(d_state(s, r), by_state, 1e-4);
  const auto by_line = numeric_jacobian(
      [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
        AnchoredLine moved = s.line;
        moved.coordinates += d;
        return evaluate(s, s.state, moved).value;
      },
      4);
  expect_jacobian(r.d_line, by_line, 1e-4);
  const auto by_calibration = numeric_jacobian(
      [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
        Sight moved = s;
        moved.projection.T_i_c.q = moved.projection.T_i_c.q * quat_exp(d.head<3>());
        moved.projection.camera.fx *= std::exp(d[3]);
        moved.projection.camera.fy *= std::exp(d[3]);
        return evaluate(moved, s.state, s.line).value;
      },
      4);
  expect_jacobian(r.d_calibration, by_calibration, 1e-4);
}

TEST(AnchoredLine, AgreesWithThePointsOfTheLine) {
  const Sight s = some_sight();
  const BinResidual r = evaluate(s, s.state, s.line);
  const LineEnds ends = s.line.ends();
  const auto a = TimedCamera(s.state, s.motion, s.linearised_at, s.projection)({ends.a});
  const auto b = TimedCamera(s.state, s.motion, s.linearised_at, s.projection)({ends.b});
  EXPECT_NEAR(r.value[0], event_to_line({s.a, s.motion}, a, b, s.projection.camera).value, 1e-9);
  EXPECT_NEAR(r.value[1], event_to_line({s.b, s.motion}, a, b, s.projection.camera).value, 1e-9);
}

TEST(AnchoredLine, FollowsMovesOfTheWorld) {
  const AnchoredLine line = some_sight().line;
  const LineEnds ends = line.ends();
  const Eigen::Matrix4d moves = line.world_moves();
  constexpr double kStep = 1e-5;
  for (int j = 0; j < 4; ++j) {
    const auto move = [&](const Vec3& x) -> Vec3 {
      return j < 3 ? Vec3(x + kStep * Vec3::Unit(j)) : quat_exp(kStep * Vec3::UnitZ()) * x;
    };
    AnchoredLine moved = line;
    moved.coordinates += kStep * moves.col(j);
    const LineEnds now = moved.ends();
    const Vec3 a = move(ends.a), along = (move(ends.b) - a).normalized();
    for (const Vec3& end : {now.a, now.b}) EXPECT_LT((end - a).cross(along).norm(), 1e-8) << "move " << j;
    EXPECT_GT((now.a - ends.a).norm(), 1e-7);
  }
}

TEST(AnchoredLine, NothingHappensAtInfinity) {
  Sight s = some_sight();
  s.line.coordinates << 0, 0, 0, 0;
  const BinResidual r = evaluate(s, s.state, s.line);
  EXPECT_TRUE(r.valid);
  EXPECT_TRUE(r.value.allFinite() && r.d_line.allFinite() && r.d_camera.allFinite());
  EXPECT_FALSE(s.line.finite());
  // Only turning moves the image of a line at infinity.
  EXPECT_LT(d_state(s, r).leftCols<3>().norm(), 1e-9);
}

// A positive system in chain form, and the same as one dense matrix (states first).
ChainSystem random_chain(std::size_t states, Eigen::Index columns, Eigen::MatrixXd& H, Eigen::VectorXd& g) {
  const auto n = static_cast<Eigen::Index>(states) * kStateDim;
  std::srand(5);
  H = Eigen::MatrixXd::Zero(n + columns, n + columns);
  // Factors between neighbours and lines, so that the structure is kept; later states see later lines.
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(states); ++i) {
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(40, n + columns);
    J.middleCols(i * kStateDim, kStateDim).setRandom();
    if ((i + 1) * kStateDim < n) J.middleCols((i + 1) * kStateDim, kStateDim).setRandom();
    H += J.transpose() * J;
    J.setZero();
    J.middleCols(i * kStateDim, kStateDim).setRandom();
    J.middleCols(n, std::min(columns, 4 * (i + 1))).setRandom();
    H += J.transpose() * J;
  }
  g = Eigen::VectorXd::Random(n + columns);
  ChainSystem system(states, columns);
  for (std::size_t i = 0; i < states; ++i) {
    const auto at = static_cast<Eigen::Index>(i) * kStateDim;
    system.diagonal[i] = H.block<kStateDim, kStateDim>(at, at);
    if (i + 1 < states) system.next[i] = H.block<kStateDim, kStateDim>(at, at + kStateDim);
    for (Eigen::Index c = 0; c < columns; c += 4)
      if (const auto block = H.block<kStateDim, 4>(at, n + c); !block.isZero()) system.lines[i].at(c) = block;
    system.state_gradient[i] = g.segment<kStateDim>(at);
  }
  system.line_block = H.bottomRightCorner(columns, columns);
  system.line_gradient = g.tail(columns);
  return system;
}

TEST(ChainSystem, SolvesLikeADenseSystem) {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  constexpr std::size_t kStates = 40;  // more than are taken together
  const ChainSystem system = random_chain(kStates, 16, H, g);
  for (double damping : {0.0, 0.1}) {
    Eigen::MatrixXd damped = H;
    damped.diagonal() *= 1 + damping;
    const Eigen::VectorXd expected = damped.ldlt().solve(-g);
    const auto step = system.solve(damping);
    ASSERT_EQ(step.states.size(), kStates);
    for (std::size_t i = 0; i < kStates; ++i)
      EXPECT_LT(
          (step.states[i] - expected.segment<kStateDim>(kStateDim * static_cast<Eigen::Index>(i))).norm(),
          1e-8);
    EXPECT_LT((step.lines - expected.tail(16)).norm(), 1e-8);
    EXPECT_LT((step.last_covariance - damped.inverse()
                                          .bottomRightCorner(16 + kStateDim, 16 + kStateDim)
                                          .topLeftCorner<kStateDim, kStateDim>())
                  .norm(),
              1e-8);
  }
}

TEST(Dense, DoesWhatEigenDoes) {
  std::srand(6);
  const Eigen::MatrixXd W = Eigen::MatrixXd::Random(20, 40), B = Eigen::MatrixXd::Random(20, 7);
  // Parts of larger matrices, too.
  Eigen::MatrixXd whole = Eigen::MatrixXd::Random(30, 30), C = whole;
  subtract_product(C.block(2, 3, 12, 7), W.middleCols(5, 12), B);
  Eigen::MatrixXd expected = whole;
  expected.block(2, 3, 12, 7) -= W.middleCols(5, 12).transpose() * B;
  EXPECT_LT((C - expected).norm(), 1e-12);

  C = expected = whole;
  subtract_gram(C.bottomRightCorner(12, 12), W.middleCols(5, 12));
  expected.bottomRightCorner(12, 12).triangularView<Eigen::Lower>() -=
      W.middleCols(5, 12).transpose() * W.middleCols(5, 12);
  EXPECT_LT((C - expected).norm(), 1e-12);

  Eigen::MatrixXd A = W * W.transpose(), solved = B;
  const Eigen::MatrixXd L = A.llt().matrixL();
  ASSERT_TRUE(factor_lower(A));
  EXPECT_LT((Eigen::MatrixXd(A.triangularView<Eigen::Lower>()) - L).norm(), 1e-10);
  solve_lower(A, solved);
  EXPECT_LT((L * solved - B).norm(), 1e-10);

  Eigen::MatrixXd R = W.transpose();
  replace_by_triangular_factor(R);
  EXPECT_EQ(R.rows(), 20);
  EXPECT_TRUE(R.isUpperTriangular(0));
  EXPECT_LT((R.transpose() * R - W * W.transpose()).norm(), 1e-11);
  EXPECT_LT((gram(W.transpose()) - W * W.transpose()).norm(), 1e-11);

  Eigen::MatrixXd negative = -Eigen::MatrixXd::Identity(3, 3), none(0, 0);
  EXPECT_FALSE(factor_lower(negative));
  EXPECT_TRUE(factor_lower(none));
  EXPECT_THROW(subtract_gram(C, W), std::invalid_argument);
}

TEST(Backend, StatesBetweenTwoLieOnTheMotion) {
  HandMotion motion;
  motion.still_s = 0;
  motion.speed = 2;
  const Spline spline = hand_motion({}, motion);
  const auto state = [&](double s) {
    const Kinematics k = spline.at(s);
    NavState out;
    out.t = from_seconds(s);
    out.T_w_i = k.T_w_i;
    out.v_w = k.velocity_w;
    return out;
  };
  constexpr double kStep = 0.05, kTurn = 1.2e-4;
  double turned = 0;
  for (double s = 3; s < 7; s += kStep) {
    const NavState from = state(s), to = state(s + kStep);
    turned = std::max(turned, (spline.at(s + kStep).rate_i - spline.at(s).rate_i).norm());
    for (double u : {0.0, 0.2, 0.5, 0.9, 1.0}) {
      const NavState expected = state(s + u * kStep);
      const NavState got =
          state_between(from, spline.at(s).rate_i, to, spline.at(s + kStep).rate_i, expected.t);
      EXPECT_EQ(got.t, expected.t);
      EXPECT_LT((got.T_w_i.p - expected.T_w_i.p).norm(), 6e-5);
      EXPECT_LT(quat_log(got.T_w_i.q.conjugate() * expected.T_w_i.q).norm(), kTurn);
      EXPECT_LT((got.v_w - expected.v_w).norm(), 5e-3);
    }
  }
  EXPECT_GT(turned * kStep / 8, 5 * kTurn);  // so far off is a constant rate
}

TEST(ChainSystem, AnIndefiniteSystemGivesNoStep) {
  ChainSystem system(2, 4);
  EXPECT_TRUE(system.solve(0).states.empty());
}

}  // namespace
}  // namespace idol::test
