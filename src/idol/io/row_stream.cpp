#include "idol/io/row_stream.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string_view>

namespace idol {
namespace {

constexpr double kLargestBadShare = 1e-3;
constexpr std::int64_t kFewestBadRows = 3;  // below that they count as isolated, however short the file
constexpr std::int64_t kMostLateInARow = 1000;
// Fewer late rows in a row are a passing matter; events come in thousands.
constexpr std::int64_t kShortestImuReset = 3, kShortestEventReset = 20;
constexpr Time kJitter = 1'000'000;  // [ns]: of stamps that are made by several threads

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

void RowRules::late_row(std::size_t i, Time t, Time previous, Time newest, bool sorted) {
  const std::string place = place_.where(i);
  if (run_.rows > 0 && t >= previous) {
    ++run_.rows;
  } else {
    run_ = {1, newest, t, t, place};
  }
  run_.last = t;
  if (run_.rows > kMostLateInARow) refuse_reset();
  const std::string message = fmt::format("{}: the stamp is {:.3f} ms before one already read", place,
                                          1e-6 * static_cast<double>(newest - t));
  const std::string kind = fmt::format("out_of_order_{}", row_name_);
  if (sorted) return diagnostics_.warn(kind, message + "; row put in its place");
  diagnostics_.warn(kind, message + "; row dropped");
  if (newest - t <= kJitter) return;
  ++late_;
  if (first_late_.empty()) first_late_ = place;
}

std::int64_t RowRules::shortest_reset() const {
  return row_name_ == std::string_view("imu") ? kShortestImuReset : kShortestEventReset;
}

// Packets that were swapped come with a step ahead behind them, as long as the other packet. A clock that was
// set back goes on from where it is, through a time that was there before.
void RowRules::end_run(Time t) {
  const Time back = run_.newest - run_.first, step = t - run_.last;
  if (run_.rows >= shortest_reset() && run_.last - run_.first > back / 2 && step < back / 4) refuse_reset();
  run_ = {};
}

void RowRules::refuse_reset() const {
  throw DataError(fmt::format(
      "{}: {} stamps went back by {:.3f} ms and stay behind for {} rows; split the recording where its clock "
      "was set back",
      run_.place, row_name_, 1e-6 * static_cast<double>(run_.newest - run_.first), run_.rows));
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
  if (static_cast<double>(bad_rows()) > expected + 4 * std::sqrt(expected)) refuse_share();
}

void RowRules::check_share() const {
  if (bad_rows() >= kFewestBadRows &&
      static_cast<double>(bad_rows()) > kLargestBadShare * static_cast<double>(rows_))
    refuse_share();
}

void RowRules::refuse_share() const {
  const double percent = 100.0 * static_cast<double>(bad_rows()) / static_cast<double>(rows_);
  if (late_ > not_finite_ + outside_)
    throw DataError(fmt::format(
        "{}: stamps go back by more than 1 ms again and again, in {} of the first {} rows ({:.2f} %), first "
        "{}; sort the recording by time",
        place_.name(), late_, rows_, percent, first_late_));
  const char* advice = outside_ > not_finite_ ? "is the rig, or its resolution, that of another sensor?"
                                              : "the recording is damaged; write it again without them";
  throw DataError(fmt::format("{}: {} of the first {} rows ({:.2f} %) are unusable, first {}; {}",
                              place_.name(), bad_rows(), rows_, percent, first_bad_, advice));
}

}  // namespace idol
