#include "idol/io/row_check.hpp"

#include <fmt/format.h>

namespace idol {
namespace {

RowResult bad_stamp(Time t) {
  return {RowStatus::kBroken, fmt::format("{} ns cannot be a stamp: it lies beyond 145 years", t)};
}

}  // namespace

RowResult RowCheck<Event>::explain(const Event& e) const {
  if (!good_stamp(e.t)) return bad_stamp(e.t);
  return {RowStatus::kOutside,
          fmt::format("pixel ({}, {}) lies outside the sensor of {} x {}", e.x, e.y, width_, height_)};
}

RowResult RowCheck<ImuSample>::explain(const ImuSample& sample) const {
  if (!RowCheck<Event>::good_stamp(sample.t)) return bad_stamp(sample.t);
  if (!sample.accel.allFinite() || !sample.gyro.allFinite())
    return {RowStatus::kNotFinite, "a value is not finite"};
  return {RowStatus::kNotFinite, "a value is beyond any sensor's range"};
}

}  // namespace idol
