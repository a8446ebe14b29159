// The rows of one stream, clean and in time order: what is rare is skipped and counted, what is not is an
// error.
#pragma once

#include <algorithm>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"
#include "idol/io/row_check.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

/// The rules by which odd rows are skipped (and counted in Diagnostics) or refused (DataError).
class RowRules {
 public:
  RowRules(const char* row_name, const StreamPlace& place, Diagnostics& diagnostics)
      : row_name_(row_name), place_(place), diagnostics_(diagnostics) {}

  /// Judges row `i` of the piece, which could not be used; returns if it may be skipped.
  void bad_row(std::size_t i, const RowResult& row);
  /// A row earlier than one before it in the file.
  void late_row(std::size_t i, Time t, Time previous, Time newest);
  /// A row that was used, or that was bad.
  void count_row() {
    if (++rows_ == next_check_) check_early();
  }
  /// How many more rows may be counted at once, and counting them.
  [[nodiscard]] std::int64_t rows_until_check() const { return next_check_ - rows_ - 1; }
  void count_rows(std::int64_t rows) { rows_ += rows; }
  /// A row in order that comes long after the one before it, before row `i` of the piece.
  void check_jump(std::size_t i, Time previous, Time t) const {
    // The difference of two stamps may be beyond the range of Time.
    if (t > 0 && previous < t - kJumpAhead) refuse_jump(i, previous, t);
  }
  /// A row in order: late rows before it were a passing matter.
  void in_order() { late_in_a_row_ = 0; }
  /// At the end of the stream: the share of bad rows must be small.
  void check_share() const;

 private:
  // No recording pauses so long, and windows tile all time that passes [ns].
  static constexpr Time kJumpAhead = 600'000'000'000;
  void check_early();
  [[noreturn]] void refuse_share() const;
  [[noreturn]] void refuse_jump(std::size_t i, Time previous, Time t) const;

  const char* row_name_;
  const StreamPlace& place_;
  Diagnostics& diagnostics_;
  std::int64_t rows_ = 0;
  std::int64_t next_check_ = 10000;
  std::int64_t not_finite_ = 0;
  std::int64_t outside_ = 0;
  std::int64_t jumps_back_ = 0;
  std::int64_t late_in_a_row_ = 0;
  std::string first_bad_;
};

template <class Row>
class RowStream {
 public:
  /// `diagnostics` must outlive the stream.
  RowStream(std::unique_ptr<RowSource<Row>> source, RowCheck<Row> check, Diagnostics& diagnostics)
      : source_(std::move(source)), check_(check), rules_(RowCheck<Row>::kName, *source_, diagnostics) {}

  /// The next row, none earlier than the one before; false at the end. Throws DataError on damage, after all
  /// rows before it were given out.
  bool next(Row& out) {
    if (damage_) std::rethrow_exception(damage_);
    try {
      Row row;
      while (read(row)) {
        if (!held_) {
          hold(row);
        } else if (row.t >= held_row_.t) {
          give(out);
          hold(row);
          rules_.in_order();
          return true;
        } else {
          put_late(row);
        }
      }
      if (!held_) rules_.check_share();
    } catch (const DataError&) {
      damage_ = std::current_exception();
      if (!held_) throw;
    }
    if (!held_) return false;
    held_ = false;
    give(out);
    return true;
  }

  /// Appends rows that next() would give out, those that need no second look: at most `most`, and only stamps
  /// before `end`. Perhaps none, though next() has more.
  void next_plain(std::vector<Row>& out, std::size_t most, Time end) {
    if (!held_ || damage_ || !near(given_, held_row_.t)) return;
    most = std::min({most, piece_.size() - next_, static_cast<std::size_t>(rules_.rows_until_check())});
    // Each row is confirmed by the one behind it.
    std::size_t count = 0;
    const Row* rows = piece_.data() + next_;
    for (Time t = held_row_.t; count < most && t < end; t = rows[count++].t)
      if (!near(t, rows[count].t) || !check_.good(rows[count])) break;
    if (count == 0) return;
    out.push_back(held_row_);
    out.insert(out.end(), rows, rows + count - 1);
    given_ = out.back().t;
    held_row_ = rows[count - 1];
    previous_ = held_row_.t;
    next_ += count;
    rules_.count_rows(static_cast<std::int64_t>(count));
    rules_.in_order();
  }

  [[nodiscard]] const StreamPlace& place() const { return *source_; }
  /// Where the IMU row that next() gave out last is, if it has the stamp of the one before; else empty.
  [[nodiscard]] const std::string& repeated_at() const { return given_at_; }
  /// For a stream that is not read to its end. Throws DataError.
  void check_share() const { rules_.check_share(); }

 private:
  bool read(Row& row) {
    for (;;) {
      while (next_ < piece_.size()) {
        row = piece_[next_++];
        const bool good = check_.good(row);
        if (!good) rules_.bad_row(next_ - 1, check_.explain(row));
        rules_.count_row();
        if (good) return true;
      }
      piece_ = source_->read();
      next_ = 0;
      if (!piece_.empty()) continue;
      if (source_->odd().status == RowStatus::kGood) return false;
      rules_.bad_row(0, source_->odd());
      rules_.count_row();
    }
  }

  /// In order, and not long after: nothing to be looked into.
  static bool near(Time before, Time after) {
    constexpr Time kNear = 1'000'000'000;
    return after >= before && after <= before + kNear;
  }

  /// The row being read.
  [[nodiscard]] std::size_t here() const { return next_ == 0 ? 0 : next_ - 1; }

  void hold(const Row& row) {
    held_row_ = row;
    held_ = true;
    previous_ = row.t;
    // Events have one stamp often, and nobody asks where.
    if constexpr (std::is_same_v<Row, ImuSample>)
      held_at_ = row.t == given_ ? source_->where(here()) : std::string();
  }

  void give(Row& out) {
    constexpr Time kNone = std::numeric_limits<Time>::min();
    if (given_ != kNone) rules_.check_jump(here(), given_, held_row_.t);
    out = held_row_;
    given_ = out.t;
    given_at_ = std::move(held_at_);
  }

  void put_late(const Row& row) {
    rules_.late_row(here(), row.t, previous_, held_row_.t);
    // One stamp ahead of its neighbours on both sides: it is that one that is wrong.
    constexpr Time kGlitch = 1'000'000;
    if (previous_ == held_row_.t && held_row_.t - row.t > kGlitch && row.t >= given_) hold(row);
    previous_ = row.t;
  }

  std::unique_ptr<RowSource<Row>> source_;
  RowCheck<Row> check_;
  RowRules rules_;
  std::span<const Row> piece_;
  std::size_t next_ = 0;  // row of the piece to be read next
  Row held_row_{};        // read, but not given out before the next row confirms its stamp
  bool held_ = false;
  Time given_ = std::numeric_limits<Time>::min();  // stamp of the last row given out
  Time previous_ = 0;                              // stamp of the last row of the file, used or not
  std::string held_at_, given_at_;                 // places of IMU rows that have the stamp of the one before
  std::exception_ptr damage_;
};

}  // namespace idol
