#include "idol/base/input_check.hpp"

#include <fmt/format.h>

namespace idol {
namespace {

RowResult bad_stamp(Time t) {
  return {RowStatus::kBroken, fmt::format("{} ns cannot be a stamp: it lies beyond 145 years", t)};
}

}  // namespace

RowResult InputCheck<Event>::explain(const Event& e) const {
  if (!good_stamp(e.t)) return bad_stamp(e.t);
  return {RowStatus::kOutside,
          fmt::format("pixel ({}, {}) lies outside the sensor of {} x {}", e.x, e.y, width_, height_)};
}

RowResult InputCheck<ImuSample>::explain(const ImuSample& sample) const {
  if (!InputCheck<Event>::good_stamp(sample.t)) return bad_stamp(sample.t);
  if (!sample.accel.allFinite() || !sample.gyro.allFinite())
    return {RowStatus::kNotFinite, "a value is not finite"};
  return {RowStatus::kNotFinite, "a value is beyond any sensor's range"};
}

template <class Row>
void PushCheck<Row>::refuse(const Row& row, Diagnostics& diagnostics) {
  std::string why;
  if (!check_.good(row)) {
    why = check_.explain(row).why;
  } else if (row.t < last_) {
    why = fmt::format("the stamp {:.9f} s is {:.3f} ms before the one before it",
                      static_cast<double>(row.t) / kNsPerS, 1e-6 * static_cast<double>(last_ - row.t));
  } else {
    constexpr int kSure = 50;
    why = fmt::format("the stamp {:.3f} s is {:.0f} s after the one before it",
                      static_cast<double>(row.t) / kNsPerS, seconds_between(last_, row.t));
    if (++ahead_ >= kSure)
      throw DataError(
          fmt::format("{}: {}, as are those behind it; the clock was set: begin anew with another Odometry",
                      InputCheck<Row>::kName, why));
  }
  diagnostics.warn(fmt::format("refused_{}", InputCheck<Row>::kName),
                   fmt::format("{}: {}; left out", InputCheck<Row>::kName, why));
}

template class PushCheck<Event>;
template class PushCheck<ImuSample>;

}  // namespace idol
