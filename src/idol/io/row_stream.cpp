#include "idol/io/row_stream.hpp"

#include <fmt/format.h>

#include <cmath>

namespace idol {
namespace {

constexpr double kLargestBadShare = 1e-3;
constexpr std::int64_t kFewestBadRows = 3;  // below that they count as isolated, however short the file
constexpr std::int64_t kMostJumpsBack = 10;
constexpr std::int64_t kMostLateInARow = 1000;
constexpr Time kJumpBack = 1'000'000;  // [ns]

}  // namespace

void RowRules::bad_row(std::size_t i, const RowResult& row) {
  const std::string message = fmt::format("{}: {}", place_.where(i), row.why);
  if (row.status == RowStatus::kTorn && rows_ > 0) {
    diagnostics_.warn("incomplete_last_row", message + "; the file ends inside this row, which is skipped");
    return;
  }
  if (row.status == RowStatus::kNotFinite) {
    diagnostics_.warn("nan_row", message + "; row skipped");
    ++not_finite_;
  } else if (row.status == RowStatus::kOutside) {
    diagnostics_.warn("outside_pixel", message + "; row skipped");
    ++outside_;
  } else {
    throw DataError(message);
  }
  if (first_bad_.empty()) first_bad_ = message;
}

void RowRules::late_row(std::size_t i, Time t, Time previous, Time newest) {
  const double back_ms = static_cast<double>(newest - t) / 1e6;
  if (previous - t > kJumpBack && ++jumps_back_ > kMostJumpsBack) {
    throw DataError(
        fmt::format("{}: stamps go back by more than 1 ms again and again (here by {:.3f} ms); sort the "
                    "file by time",
                    place_.where(i), back_ms));
  }
  if (++late_in_a_row_ > kMostLateInARow) {
    throw DataError(
        fmt::format("{}: stamps went back by {:.3f} ms and stay behind; split the file where its clock "
                    "was reset",
                    place_.where(i), back_ms));
  }
  diagnostics_.warn(fmt::format("out_of_order_{}", row_name_),
                    fmt::format("{}: the stamp is {:.3f} ms before one already read; row dropped",
                                place_.where(i), back_ms));
}

void RowRules::refuse_jump(std::size_t i, Time previous, Time t) const {
  throw DataError(fmt::format(
      "{}: {} stamps jump ahead, from {:.6f} to {:.6f} s, before this row; split the file where "
      "its clock was set",
      place_.where(i), row_name_, static_cast<double>(previous) / 1e9, static_cast<double>(t) / 1e9));
}

void RowRules::check_early() {
  // Only what the share of the whole file will not make good again: beyond it by four standard deviations.
  constexpr std::int64_t kStep = 10000;
  next_check_ += kStep;
  const double expected = kLargestBadShare * static_cast<double>(rows_);
  if (static_cast<double>(not_finite_ + outside_) > expected + 4 * std::sqrt(expected)) refuse_share();
}

void RowRules::check_share() const {
  const std::int64_t bad = not_finite_ + outside_;
  if (bad >= kFewestBadRows && static_cast<double>(bad) > kLargestBadShare * static_cast<double>(rows_))
    refuse_share();
}

void RowRules::refuse_share() const {
  const std::int64_t bad = not_finite_ + outside_;
  const char* advice = outside_ > not_finite_ ? "is the rig, or its resolution, that of another sensor?"
                                              : "the recording is damaged; write it again without them";
  throw DataError(
      fmt::format("{}: {} of the first {} rows ({:.2f} %) are unusable, first {}; {}", place_.name(), bad,
                  rows_, 100.0 * static_cast<double>(bad) / static_cast<double>(rows_), first_bad_, advice));
}

}  // namespace idol
