#include "idol/base/lie.hpp"

#include "test_util.hpp"

namespace idol {
namespace {

TEST(Lie, ExpAndLogAreInverse) {
  std::mt19937 rng(1);
  for (double sigma : {1e-12, 1e-7, 1e-4, 0.1, 1.0}) {
    for (int i = 0; i < 50; ++i) {
      Vec3 theta = test::random_vec3(rng, sigma);
      if (theta.norm() > 3.1) theta *= 3.1 / theta.norm();
      EXPECT_LT((so3_log(so3_exp(theta)) - theta).norm(), 1e-9 * (1 + 1 / (3.2 - theta.norm())));
      EXPECT_LT((quat_log(quat_exp(theta)) - theta).norm(), 1e-12);
      EXPECT_LT((quat_exp(theta).toRotationMatrix() - so3_exp(theta)).norm(), 1e-14);
    }
  }
}

TEST(Lie, RightJacobianMatchesNumericAndInverse) {
  std::mt19937 rng(2);
  for (double sigma : {1e-9, 1e-4, 1e-3, 0.5}) {
    for (int i = 0; i < 20; ++i) {
      const Vec3 theta = test::random_vec3(rng, sigma);
      const Mat3 numeric = test::numeric_jacobian(
          [&](const Eigen::VectorXd& d) -> Eigen::VectorXd {
            return quat_log(quat_exp(theta).conjugate() * quat_exp(theta + Vec3(d)));
          },
          3);
      test::expect_jacobian(right_jacobian(theta), numeric, 1e-8);
      EXPECT_LT((right_jacobian(theta) * right_jacobian_inverse(theta) - Mat3::Identity()).norm(), 1e-9);
    }
  }
}

TEST(Lie, PoseComposesAndInverts) {
  std::mt19937 rng(3);
  const Pose a{quat_exp(test::random_vec3(rng)), test::random_vec3(rng)};
  const Pose b{quat_exp(test::random_vec3(rng)), test::random_vec3(rng)};
  const Vec3 x = test::random_vec3(rng);
  EXPECT_LT(((a * b) * x - a * (b * x)).norm(), 1e-12);
  EXPECT_LT((a.inverse() * (a * x) - x).norm(), 1e-12);
}

}  // namespace
}  // namespace idol
