// Whether an event or an IMU sample can be used at all: the one check of every door, be it a file, the
// library or Python.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol {

/// Stamps lie within +-145 years of zero, so that the difference of any two is a Time as well [ns].
constexpr Time kLargestStamp = 4'600'000'000'000'000'000;

enum class RowStatus {
  kGood,
  kNothing,    ///< blank line or comment
  kNotFinite,  ///< NaN, infinite, or beyond any sensor: may be skipped when rare
  kOutside,    ///< pixel outside the sensor: may be skipped when rare
  kTorn,       ///< the last row, and the file ends inside it: skipped
  kColumns,    ///< wrong number of columns
  kBroken,     ///< a value that makes no sense
};

/// What a row is and, unless it is good, why.
struct RowResult {
  RowStatus status = RowStatus::kGood;
  std::string why = {};
};

template <class Row>
class InputCheck;

template <>
class InputCheck<Event> {
 public:
  static constexpr const char* kName = "event";

  InputCheck() = default;
  /// A sensor of `width` x `height` pixels; zero where unknown.
  InputCheck(int width, int height) {
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
class InputCheck<ImuSample> {
 public:
  static constexpr const char* kName = "imu";

  [[nodiscard]] bool good(const ImuSample& s) const {
    return InputCheck<Event>::good_stamp(s.t) && within(s.accel) && within(s.gyro);
  }
  [[nodiscard]] RowResult explain(const ImuSample& sample) const;

 private:
  /// Whatever the unit is; false for NaN.
  static bool within(const Vec3& v) {
    constexpr double kBeyondAnySensor = 1e5;
    return v.cwiseAbs().maxCoeff<Eigen::PropagateNaN>() <= kBeyondAnySensor;
  }
};

/// A stream that is pushed sample by sample, in time order: what cannot be used is left out and counted, as
/// `refused_event` or `refused_imu`. A stamp far ahead is held for wrong until the stream goes on from there.
template <class Row>
class PushCheck {
 public:
  explicit PushCheck(const InputCheck<Row>& check = {}) : check_(check) {}

  /// Whether to use the sample. Throws DataError where the clock was set ahead by more than ten minutes: what
  /// lies between is no pause that an estimate survives.
  bool take(const Row& row, Diagnostics& diagnostics) {
    if (check_.good(row) && row.t >= last_ && (row.t <= last_ + kLongestPause || last_ == kNone)) {
      last_ = row.t;
      ahead_ = 0;
      return true;
    }
    refuse(row, diagnostics);
    return false;
  }

 private:
  void refuse(const Row& row, Diagnostics& diagnostics);

  static constexpr Time kNone = -kLargestStamp - 1;
  static constexpr Time kLongestPause = 600'000'000'000;
  InputCheck<Row> check_;
  Time last_ = kNone;
  int ahead_ = 0;  // samples in a row that are too far ahead
};

extern template class PushCheck<Event>;
extern template class PushCheck<ImuSample>;

}  // namespace idol
