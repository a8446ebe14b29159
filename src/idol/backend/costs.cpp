#include "idol/backend/costs.hpp"

#include <ceres/sized_cost_function.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace idol {
namespace {

template <int R, int C>
using RowMajor = Eigen::Matrix<double, R, C, (C == 1 ? Eigen::ColMajor : Eigen::RowMajor)>;
template <int R, int C>
using JacobianMap = Eigen::Map<RowMajor<R, C>>;
template <int N>
using ConstVectorMap = Eigen::Map<const Eigen::Matrix<double, N, 1>>;

template <int R, int C>
JacobianMap<R, C> jacobian_at(double* data) {
  return JacobianMap<R, C>(data);
}
template <int N>
Eigen::Map<Eigen::Matrix<double, N, 1>> vector_at(double* data) {
  return Eigen::Map<Eigen::Matrix<double, N, 1>>(data);
}

// d q / d theta of q * Exp(theta) at theta = 0, q as [x y z w]: half of the product with each pure
// quaternion.
Eigen::Matrix<double, 4, 3> quaternion_plus_jacobian(const double* q) {
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  Eigen::Matrix<double, 4, 3> J;
  J << w, -z, y, z, w, -x, -y, x, w, -x, -y, -z;
  return 0.5 * J;
}

// Jacobian by the ambient pose from that by the tangent: the plus Jacobian of a unit quaternion has
// orthogonal columns of length 1/2, so four times its transpose is its inverse from the left.
template <class Derived>
auto to_ambient(const Eigen::MatrixBase<Derived>& d_tangent, const double* pose) {
  constexpr int kRows = Derived::RowsAtCompileTime;
  RowMajor<kRows, kPoseSize> out(d_tangent.rows(), kPoseSize);
  out.template leftCols<3>() = d_tangent.template leftCols<3>();
  out.template rightCols<4>() =
      d_tangent.template middleCols<3>(3) * (4 * quaternion_plus_jacobian(pose + 3).transpose());
  return out;
}

}  // namespace

StateParameters to_parameters(const NavState& state) {
  StateParameters out;
  out.pose << state.T_w_i.p, state.T_w_i.q.coeffs();
  out.motion << state.v_w, state.bias.gyro, state.bias.accel;
  return out;
}

NavState from_parameters(const double* pose, const double* motion) {
  NavState state;
  state.T_w_i.p = ConstVectorMap<3>(pose);
  state.T_w_i.q = Quat(ConstVectorMap<4>(pose + 3)).normalized();
  state.v_w = ConstVectorMap<3>(motion);
  state.bias.gyro = ConstVectorMap<3>(motion + 3);
  state.bias.accel = ConstVectorMap<3>(motion + 6);
  return state;
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  vector_at<3>(x_plus_delta) = ConstVectorMap<3>(x) + ConstVectorMap<3>(delta);
  const Quat q(ConstVectorMap<4>(x + 3));
  vector_at<4>(x_plus_delta + 3) = (q * quat_exp(ConstVectorMap<3>(delta + 3))).normalized().coeffs();
  return true;
}

bool PoseManifold::PlusJacobian(const double* x, double* jacobian) const {
  JacobianMap<7, 6> J(jacobian);
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<4, 3>() = quaternion_plus_jacobian(x + 3);
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  vector_at<3>(y_minus_x) = ConstVectorMap<3>(y) - ConstVectorMap<3>(x);
  const Quat qx(ConstVectorMap<4>(x + 3)), qy(ConstVectorMap<4>(y + 3));
  vector_at<3>(y_minus_x + 3) = quat_log(qx.conjugate() * qy);
  return true;
}

bool PoseManifold::MinusJacobian(const double* x, double* jacobian) const {
  JacobianMap<6, 7> J(jacobian);
  J.setZero();
  J.topLeftCorner<3, 3>().setIdentity();
  J.bottomRightCorner<3, 4>() = 4 * quaternion_plus_jacobian(x + 3).transpose();
  return true;
}

bool TiltManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  vector_at<3>(x_plus_delta) = ConstVectorMap<3>(x);
  const Quat q(ConstVectorMap<4>(x + 3));
  Eigen::Map<Eigen::Vector4d>(x_plus_delta + 3) =
      (quat_exp(Vec3(delta[0], delta[1], 0)) * q).normalized().coeffs();
  return true;
}

// Exp(d) q = q Exp(R^T d).
bool TiltManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Mat3 Rt = Quat(ConstVectorMap<4>(x + 3)).conjugate().toRotationMatrix();
  JacobianMap<7, 2> J(jacobian);
  J.setZero();
  J.bottomRows<4>() = quaternion_plus_jacobian(x + 3) * Rt.leftCols<2>();
  return true;
}

bool TiltManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Quat qx(ConstVectorMap<4>(x + 3)), qy(ConstVectorMap<4>(y + 3));
  const Vec3 d = quat_log(qy * qx.conjugate());
  y_minus_x[0] = d.x();
  y_minus_x[1] = d.y();
  return true;
}

bool TiltManifold::MinusJacobian(const double* x, double* jacobian) const {
  const Mat3 R = Quat(ConstVectorMap<4>(x + 3)).toRotationMatrix();
  JacobianMap<2, 7> J(jacobian);
  J.setZero();
  J.rightCols<4>() = R.topRows<2>() * (4 * quaternion_plus_jacobian(x + 3).transpose());
  return true;
}

namespace {

constexpr double kNearestDepth =
    0.01;  // [m]: ends nearer to, or behind, the anchor camera move as if they were here

// [x/z, y/z, 1/z] of a point in the camera, and its inverse.
Vec3 to_inverse_depth(const Vec3& x) {
  const double rho = 1 / std::max(x.z(), kNearestDepth);
  return {x.x() * rho, x.y() * rho, rho};
}
Vec3 from_inverse_depth(const Vec3& m) { return Vec3(m.x(), m.y(), 1) / m.z(); }

Mat3 d_point_d_inverse_depth(const Vec3& m) {
  Mat3 J;
  J << 1 / m.z(), 0, -m.x() / (m.z() * m.z()), 0, 1 / m.z(), -m.y() / (m.z() * m.z()), 0, 0,
      -1 / (m.z() * m.z());
  return J;
}

}  // namespace

bool LineManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Pose T_c_w = T_w_c_.inverse();
  for (int end = 0; end < kLineSize; end += 3) {
    const Vec3 m = to_inverse_depth(T_c_w * Vec3(ConstVectorMap<3>(x + end)));
    Vec3 moved = m + ConstVectorMap<3>(delta + end);
    // A step through infinity would come back behind the camera.
    moved.z() = std::max(moved.z(), 0.1 * m.z());
    vector_at<3>(x_plus_delta + end) = T_w_c_ * from_inverse_depth(moved);
  }
  return true;
}

bool LineManifold::PlusJacobian(const double* x, double* jacobian) const {
  const Pose T_c_w = T_w_c_.inverse();
  JacobianMap<6, 6> J(jacobian);
  J.setZero();
  for (int end = 0; end < kLineSize; end += 3)
    J.block<3, 3>(end, end) =
        T_w_c_.R() * d_point_d_inverse_depth(to_inverse_depth(T_c_w * Vec3(ConstVectorMap<3>(x + end))));
  return true;
}

bool LineManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Pose T_c_w = T_w_c_.inverse();
  for (int end = 0; end < kLineSize; end += 3)
    vector_at<3>(y_minus_x + end) = to_inverse_depth(T_c_w * Vec3(ConstVectorMap<3>(y + end))) -
                                    to_inverse_depth(T_c_w * Vec3(ConstVectorMap<3>(x + end)));
  return true;
}

bool LineManifold::MinusJacobian(const double* x, double* jacobian) const {
  RowMajor<6, 6> plus;
  PlusJacobian(x, plus.data());
  jacobian_at<6, 6>(jacobian) = plus.inverse();
  return true;
}

namespace {

// Huber's loss as a factor on residual and Jacobian: value' = sqrt(rho), d' = d value' / d value.
struct Robustified {
  double value, slope;
};
Robustified huber(double r, double k) {
  if (k <= 0 || std::abs(r) <= k) return {r, 1};
  const double root = std::sqrt(2 * k * std::abs(r) - k * k);
  return {std::copysign(root, r), k / root};
}

class EventLineCost : public ceres::CostFunction {
 public:
  EventLineCost(std::span<const EventMeasurement> events, const ImuBias& linearised_at,
                const Projection& projection, const LineNoise& noise)
      : events_(events), linearised_at_(linearised_at), projection_(projection), noise_(noise) {
    set_num_residuals(2 * static_cast<int>(events_.size()));
    *mutable_parameter_block_sizes() = {kPoseSize, kMotionSize, kLineSize};
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const NavState state = from_parameters(parameters[0], parameters[1]);
    const Vec3 end_a = ConstVectorMap<3>(parameters[2]);
    const Vec3 end_b = ConstVectorMap<3>(parameters[2] + 3);
    for (std::size_t i = 0; i < events_.size(); ++i) {
      const EventMeasurement& event = events_[i];
      const TimedCamera camera(state, event.motion, linearised_at_, projection_);
      const PointInCamera a = camera({end_a}), b = camera({end_b});
      const LineResidual distance = event_to_line(event, a, b, projection_.camera);
      const LineResidual push = repulsion(event, a, b, projection_.camera);
      const auto robust = huber(distance.value / noise_.event_px, noise_.huber_sigmas);
      write(2 * static_cast<Eigen::Index>(i), robust.value, robust.slope / noise_.event_px, distance,
            parameters[0], residuals, jacobians);
      const double weight = 1 / noise_.repulsion_px;
      write(2 * static_cast<Eigen::Index>(i) + 1, push.value * weight, weight, push, parameters[0], residuals,
            jacobians);
    }
    return true;
  }

 private:
  static void write(Eigen::Index row, double value, double scale, const LineResidual& r, const double* pose,
                    double* residuals, double** jacobians) {
    residuals[row] = value;
    if (jacobians == nullptr) return;
    if (jacobians[0] != nullptr)
      jacobian_at<1, kPoseSize>(jacobians[0] + row * kPoseSize) =
          to_ambient(scale * r.d_state.head<6>(), pose);
    if (jacobians[1] != nullptr)
      jacobian_at<1, kMotionSize>(jacobians[1] + row * kMotionSize) = scale * r.d_state.tail<9>();
    if (jacobians[2] != nullptr) jacobian_at<1, kLineSize>(jacobians[2] + row * kLineSize) = scale * r.d_line;
  }

  std::span<const EventMeasurement> events_;
  ImuBias linearised_at_;
  Projection projection_;
  LineNoise noise_;
};

class AttractionCost : public ceres::SizedCostFunction<1, kPoseSize, kMotionSize, kLineSize> {
 public:
  AttractionCost(const Preintegrated& motion, const ImuBias& linearised_at, const Projection& projection,
                 double sigma)
      : motion_(motion), linearised_at_(linearised_at), projection_(projection), sigma_(sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const NavState state = from_parameters(parameters[0], parameters[1]);
    const TimedCamera camera(state, motion_, linearised_at_, projection_);
    const auto a = camera({ConstVectorMap<3>(parameters[2])}),
               b = camera({ConstVectorMap<3>(parameters[2] + 3)});
    const LineResidual r = attraction(a, b, projection_.camera);
    residuals[0] = r.value / sigma_;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr)
      jacobian_at<1, kPoseSize>(jacobians[0]) = to_ambient(r.d_state.head<6>() / sigma_, parameters[0]);
    if (jacobians[1] != nullptr) jacobian_at<1, kMotionSize>(jacobians[1]) = r.d_state.tail<9>() / sigma_;
    if (jacobians[2] != nullptr) jacobian_at<1, kLineSize>(jacobians[2]) = r.d_line / sigma_;
    return true;
  }

 private:
  Preintegrated motion_;
  ImuBias linearised_at_;
  Projection projection_;
  double sigma_;
};

class DepthPriorCost : public ceres::SizedCostFunction<3, kLineSize> {
 public:
  DepthPriorCost(const Pose& T_w_c, double depth, double sigma_log, double sigma_slant)
      : origin_(T_w_c.p),
        axis_(T_w_c.q * Vec3::UnitZ()),
        log_depth_(std::log(depth)),
        sigma_(sigma_log),
        slant_(sigma_slant) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    double log_z[2];
    RowVec3 d[2];
    for (int k = 0; k < 2; ++k) {
      const double z = axis_.dot(ConstVectorMap<3>(parameters[0] + 3 * k) - origin_);
      // Below 1 cm the logarithm goes on as a straight line: a step of the solver may land behind the camera.
      constexpr double kNear = 0.01;
      log_z[k] = z > kNear ? std::log(z) : std::log(kNear) + (z - kNear) / kNear;
      d[k] = axis_.transpose() / std::max(z, kNear);
    }
    residuals[0] = (log_z[0] - log_depth_) / sigma_;
    residuals[1] = (log_z[1] - log_depth_) / sigma_;
    residuals[2] = (log_z[1] - log_z[0]) / slant_;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      JacobianMap<3, kLineSize> J(jacobians[0]);
      J.setZero();
      J.block<1, 3>(0, 0) = d[0] / sigma_;
      J.block<1, 3>(1, 3) = d[1] / sigma_;
      J.block<1, 3>(2, 0) = -d[0] / slant_;
      J.block<1, 3>(2, 3) = d[1] / slant_;
    }
    return true;
  }

 private:
  Vec3 origin_, axis_;
  double log_depth_, sigma_, slant_;
};

class EndDampingCost : public ceres::SizedCostFunction<2, kLineSize> {
 public:
  EndDampingCost(const LineEnds& now, double sigma)
      : now_(now), along_((now.b - now.a).normalized() / sigma) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    residuals[0] = along_.dot(ConstVectorMap<3>(parameters[0]) - now_.a);
    residuals[1] = along_.dot(ConstVectorMap<3>(parameters[0] + 3) - now_.b);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      JacobianMap<2, kLineSize> J(jacobians[0]);
      J << along_.transpose(), RowVec3::Zero(), RowVec3::Zero(), along_.transpose();
    }
    return true;
  }

 private:
  LineEnds now_;
  Vec3 along_;
};

class ImuCost : public ceres::SizedCostFunction<9, kPoseSize, kMotionSize, kPoseSize, kMotionSize> {
 public:
  ImuCost(const Preintegrated& motion, const Mat9& covariance, const ImuBias& linearised_at,
          const Vec3& gravity)
      : motion_(motion), linearised_at_(linearised_at), gravity_(gravity) {
    // covariance = L L^T, information = W^T W with W = L^-1.
    whitener_ = covariance.llt().matrixL().solve(Mat9::Identity());
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const NavState from = from_parameters(parameters[0], parameters[1]);
    const NavState to = from_parameters(parameters[2], parameters[3]);
    const ImuResidual r = imu_residual(from, to, motion_, linearised_at_, gravity_);
    vector_at<9>(residuals).noalias() = whitener_ * r.value;
    if (jacobians == nullptr) return true;
    const Eigen::Matrix<double, 9, 15> d_from = whitener_ * r.d_from;
    const Eigen::Matrix<double, 9, 15> d_to = whitener_ * r.d_to;
    if (jacobians[0] != nullptr)
      jacobian_at<9, kPoseSize>(jacobians[0]) = to_ambient(d_from.leftCols<6>(), parameters[0]);
    if (jacobians[1] != nullptr) jacobian_at<9, kMotionSize>(jacobians[1]) = d_from.rightCols<9>();
    if (jacobians[2] != nullptr)
      jacobian_at<9, kPoseSize>(jacobians[2]) = to_ambient(d_to.leftCols<6>(), parameters[2]);
    if (jacobians[3] != nullptr) jacobian_at<9, kMotionSize>(jacobians[3]) = d_to.rightCols<9>();
    return true;
  }

 private:
  Preintegrated motion_;
  ImuBias linearised_at_;
  Vec3 gravity_;
  Mat9 whitener_;
};

class BiasWalkCost : public ceres::SizedCostFunction<6, kMotionSize, kMotionSize> {
 public:
  BiasWalkCost(const ImuNoise& noise, double dt) {
    weight_.head<3>().setConstant(1 / (noise.gyro_walk * std::sqrt(dt)));
    weight_.tail<3>().setConstant(1 / (noise.accel_walk * std::sqrt(dt)));
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const auto bias = [](const double* motion) {
      return ImuBias{ConstVectorMap<3>(motion + 3), ConstVectorMap<3>(motion + 6)};
    };
    vector_at<6>(residuals) = weight_.cwiseProduct(bias_residual(bias(parameters[0]), bias(parameters[1])));
    for (int k = 0; k < 2 && jacobians != nullptr; ++k) {
      if (jacobians[k] == nullptr) continue;
      JacobianMap<6, kMotionSize> J(jacobians[k]);
      J.setZero();
      J.rightCols<6>().diagonal() = (k == 0 ? -1 : 1) * weight_;
    }
    return true;
  }

 private:
  Eigen::Matrix<double, 6, 1> weight_;
};

class MotionPriorCost : public ceres::SizedCostFunction<9, kMotionSize> {
 public:
  MotionPriorCost(const Eigen::Matrix<double, 9, 1>& mean, const Eigen::Matrix<double, 9, 1>& sigma)
      : mean_(mean), weight_(sigma.cwiseInverse()) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    vector_at<9>(residuals) = weight_.cwiseProduct(ConstVectorMap<9>(parameters[0]) - mean_);
    if (jacobians != nullptr && jacobians[0] != nullptr)
      jacobian_at<9, kMotionSize>(jacobians[0]) = weight_.asDiagonal().toDenseMatrix();
    return true;
  }

 private:
  Eigen::Matrix<double, 9, 1> mean_, weight_;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> event_line_cost(std::span<const EventMeasurement> events,
                                                     const ImuBias& linearised_at,
                                                     const Projection& projection, const LineNoise& noise) {
  return std::make_unique<EventLineCost>(events, linearised_at, projection, noise);
}
std::unique_ptr<ceres::CostFunction> attraction_cost(const Preintegrated& motion,
                                                     const ImuBias& linearised_at,
                                                     const Projection& projection, const LineNoise& noise) {
  return std::make_unique<AttractionCost>(motion, linearised_at, projection, noise.attraction);
}
std::unique_ptr<ceres::CostFunction> depth_prior_cost(const Pose& T_w_c, double depth_m, double sigma_log,
                                                      double sigma_slant) {
  return std::make_unique<DepthPriorCost>(T_w_c, depth_m, sigma_log, sigma_slant);
}
std::unique_ptr<ceres::CostFunction> end_damping_cost(const LineEnds& now, double sigma_m) {
  return std::make_unique<EndDampingCost>(now, sigma_m);
}
std::unique_ptr<ceres::CostFunction> imu_cost(const Preintegrated& motion, const Mat9& covariance,
                                              const ImuBias& linearised_at, const Vec3& gravity) {
  return std::make_unique<ImuCost>(motion, covariance, linearised_at, gravity);
}
std::unique_ptr<ceres::CostFunction> bias_walk_cost(const ImuNoise& noise, double dt) {
  return std::make_unique<BiasWalkCost>(noise, dt);
}
std::unique_ptr<ceres::CostFunction> motion_prior_cost(const Eigen::Matrix<double, 9, 1>& mean,
                                                       const Eigen::Matrix<double, 9, 1>& sigma) {
  return std::make_unique<MotionPriorCost>(mean, sigma);
}

}  // namespace idol
