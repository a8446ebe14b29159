#include "idol/base/camera.hpp"

#include "idol/base/diagnostics.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

Camera davis240() {
  return {240,
          180,
          199.092366542,
          198.82882047,
          132.192071378,
          110.712660011,
          Distortion::kRadTan,
          {-0.368436311798, 0.150947243557, -0.000296130534385, -0.000759431726241, 0}};
}

Camera fisheye() {
  return {346, 260, 170, 171, 173, 130, Distortion::kEquidistant, {-0.03, 0.01, -0.004, 0.001, 0}};
}

TEST(Camera, UndistortInvertsDistortOnTheWholeSensor) {
  for (const Camera& camera : {davis240(), fisheye()}) {
    const UndistortMap map(camera);
    for (int y = 0; y < camera.height; y += 7) {
      for (int x = 0; x < camera.width; x += 7) {
        const Vec2 raw(x, y);
        const Vec2 plain = camera.undistort(raw);
        EXPECT_LT((camera.distort(camera.normalise(plain)) - raw).norm(), 1e-6);
        EXPECT_LT((map(x, y).cast<double>() - plain).norm(), 1e-4);
      }
    }
  }
}

TEST(Camera, AnglesSurviveTheEquidistantLens) {
  const Camera camera = fisheye();
  const double theta = 0.5;
  const double t2 = theta * theta;
  const auto& k = camera.coeffs;
  const double radius = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
  EXPECT_LT((camera.distort({std::tan(theta), 0}) - Vec2(camera.fx * radius + camera.cx, camera.cy)).norm(),
            1e-9);
  EXPECT_LT((camera.distort({0, 0}) - Vec2(camera.cx, camera.cy)).norm(), 1e-12);
}

TEST(Camera, RadTanMatchesAHandComputedPoint) {
  // OpenCV's model at n = (0.3, -0.2): r2 = 0.13, radial = 1 - 0.2 * 0.13 + 0.1 * 0.0169 = 0.97569.
  const Camera camera{100, 100, 1, 1, 0, 0, Distortion::kRadTan, {-0.2, 0.1, 0.01, 0.02, 0}};
  const Vec2 expected(0.3 * 0.97569 + 2 * 0.01 * -0.06 + 0.02 * (0.13 + 2 * 0.09),
                      -0.2 * 0.97569 + 0.01 * (0.13 + 2 * 0.04) + 2 * 0.02 * -0.06);
  EXPECT_LT((camera.distort({0.3, -0.2}) - expected).norm(), 1e-12);
}

TEST(Camera, AnImpossibleLensIsRefused) {
  Camera camera = davis240();
  camera.coeffs = {-5, 0, 0, 0, 0};  // folds the image back well inside the sensor
  EXPECT_THROW(UndistortMap map(camera), DataError);
  camera = davis240();
  camera.fx = 0;
  EXPECT_THROW(camera.check("rig.yaml"), DataError);
  camera = davis240();
  camera.width = 0;
  EXPECT_THROW(camera.check("rig.yaml"), DataError);
}

TEST(UndistortMap, WithoutCalibrationIsTheIdentity) {
  const UndistortMap map(5, 4);
  EXPECT_EQ(map(4, 3), Eigen::Vector2f(4, 3));
  EXPECT_EQ(map.width(), 5);
  EXPECT_EQ(map.height(), 4);
}

}  // namespace
}  // namespace idol
