// Whether a row can be used at all, whatever file it comes from.
#pragma once

#include <cstdint>

#include "idol/base/types.hpp"
#include "idol/io/number.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

template <class Row>
class RowCheck;

template <>
class RowCheck<Event> {
 public:
  static constexpr const char* kName = "event";

  RowCheck() = default;
  /// A sensor of `width` x `height` pixels; zero where unknown.
  RowCheck(int width, int height) {
    if (width > 0) width_ = static_cast<std::uint32_t>(width);
    if (height > 0) height_ = static_cast<std::uint32_t>(height);
  }
  [[nodiscard]] bool good(const Event& e) const { return e.x < width_ && e.y < height_ && good_stamp(e.t); }
  /// Why a row is not good.
  [[nodiscard]] RowResult explain(const Event& e) const;

  static bool good_stamp(Time t) { return t >= -kLargestStamp && t <= kLargestStamp; }

 private:
  std::uint32_t width_ = 1 << 16, height_ = 1 << 16;
};

template <>
class RowCheck<ImuSample> {
 public:
  static constexpr const char* kName = "imu";

  [[nodiscard]] bool good(const ImuSample& s) const {
    return RowCheck<Event>::good_stamp(s.t) && within(s.accel) && within(s.gyro);
  }
  [[nodiscard]] RowResult explain(const ImuSample& sample) const;

 private:
  /// Whatever the unit is; false for NaN.
  static bool within(const Vec3& v) {
    constexpr double kBeyondAnySensor = 1e5;
    return v.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= kBeyondAnySensor;
  }
};

}  // namespace idol
