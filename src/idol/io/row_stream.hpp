// The rows of one stream, clean and in time order: what is rare is skipped and counted, what is not is an
// error.
#pragma once

#include <algorithm>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/base/input_check.hpp"
#include "idol/base/types.hpp"
#include "idol/io/imu_order.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

/// The rules by which odd rows are skipped (and counted in Diagnostics) or refused (DataError).
class RowRules {
 public:
  RowRules(const char* row_name, const StreamPlace& place, Diagnostics& diagnostics)
      : row_name_(row_name), place_(place), diagnostics_(diagnostics) {}

  /// Judges row `i` of the piece, which could not be used; returns if it may be skipped.
  void bad_row(std::size_t i, const RowResult& row);
  /// A row earlier than one before it in the file, `newest`; `previous` is the row just before it. Unless
  /// `sorted`, it is dropped. Throws DataError once this is a clock that was set back.
  void late_row(std::size_t i, Time t, Time previous, Time newest, bool sorted);
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
  /// A row in order: the late rows before it were a passing matter, or a clock that was set back and has
  /// caught up.
  void in_order(Time t) {
    if (run_.rows > 0) end_run(t);
  }
  /// No row follows.
  void end() const {
    if (run_.rows >= shortest_reset()) refuse_reset();
  }
  /// It was the newest row whose stamp was wrong, not those that came late.
  void forget_run() { run_ = {}; }
  [[nodiscard]] std::int64_t late_in_a_row() const { return run_.rows; }
  /// At the end of the stream: the share of bad rows must be small.
  void check_share() const;

 private:
  // No recording pauses so long, and windows tile all time that passes [ns].
  static constexpr Time kJumpAhead = 600'000'000'000;
  /// Late rows in a row that are in order among themselves.
  struct LateRun {
    std::int64_t rows = 0;
    Time newest = 0, first = 0, last = 0;  ///< before it; of its rows
    std::string place;                     ///< of the first one
  };
  [[nodiscard]] std::int64_t shortest_reset() const;
  void end_run(Time t);
  void check_early();
  [[nodiscard]] std::int64_t bad_rows() const { return not_finite_ + outside_ + late_; }
  [[noreturn]] void refuse_share() const;
  [[noreturn]] void refuse_reset() const;
  [[noreturn]] void refuse_jump(std::size_t i, Time previous, Time t) const;

  const char* row_name_;
  const StreamPlace& place_;
  Diagnostics& diagnostics_;
  std::int64_t rows_ = 0;
  std::int64_t next_check_ = 10000;
  std::int64_t not_finite_ = 0;
  std::int64_t outside_ = 0;
  std::int64_t late_ = 0;  // dropped, and by more than what jitter explains
  LateRun run_;
  std::string first_bad_, first_late_;
};

template <class Row>
class RowStream {
 public:
  /// The first `skip` good rows are left out. `diagnostics` must outlive the stream.
  RowStream(std::unique_ptr<RowSource<Row>> source, InputCheck<Row> check, Diagnostics& diagnostics,
            std::size_t skip = 0)
      : source_(std::move(source)),
        check_(check),
        rules_(InputCheck<Row>::kName, *source_, diagnostics),
        skip_(skip) {}

  /// The next row, none earlier than the one before; false at the end. Throws DataError on damage, after all
  /// rows before it were given out.
  bool next(Row& out) {
    if constexpr (std::is_same_v<Row, ImuSample>) {
      return next_sorted(out);
    } else {
      return next_confirmed(out);
    }
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
  }

  [[nodiscard]] const StreamPlace& place() const { return *source_; }
  /// Where the IMU row that next() gave out last is, if it has the stamp of the one before; else empty.
  [[nodiscard]] const std::string& repeated_at() const { return given_at_; }
  /// For a stream that is not read to its end. Throws DataError.
  void check_share() const { rules_.check_share(); }

 private:
  /// Each row is given out once the one behind it confirms its stamp. Late ones are dropped.
  bool next_confirmed(Row& out) {
    if (damage_) std::rethrow_exception(damage_);
    try {
      Row row;
      while (read(row)) {
        if (!held_) {
          hold(row);
        } else if (row.t >= held_row_.t) {
          rules_.in_order(row.t);
          give(held_row_, out);
          hold(row);
          return true;
        } else {
          put_late(row);
        }
      }
      rules_.end();
      if (!held_) rules_.check_share();
    } catch (const DataError&) {
      damage_ = std::current_exception();
      if (!held_) throw;
    }
    if (!held_) return false;
    held_ = false;
    give(held_row_, out);
    return true;
  }

  /// Late rows are put in their places, as far as that is still possible.
  bool next_sorted(Row& out) {
    while (true) {
      if (auto settled = order_.pop(damage_ || over_)) {
        give(settled->sample, out);
        given_at_ = std::move(settled->place);
        return true;
      }
      if (damage_) std::rethrow_exception(damage_);
      if (over_) return false;
      try {
        Row row;
        over_ = !read(row);
        if (over_) {
          rules_.end();
          rules_.check_share();
        } else {
          sort_in(row);
        }
      } catch (const DataError&) {
        damage_ = std::current_exception();
      }
    }
  }

  void sort_in(const Row& row) {
    const bool late = !order_.empty() && row.t < order_.newest();
    const bool repeats = row.t == given_ || (!order_.empty() && row.t == order_.newest());
    std::string place = late || repeats ? source_->where(here()) : std::string();
    if (!late) {
      rules_.in_order(row.t);
      order_.push(row, std::move(place));
    } else {
      // One stamp ahead of several rows on both sides: it is that one that is wrong.
      constexpr std::int64_t kSure = 3;
      const Time newest = order_.newest(), before = order_.before_newest().value_or(row.t);
      const bool taken = order_.push(row, std::move(place));
      ahead_ = row.t >= (rules_.late_in_a_row() == 0 ? before : previous_) &&
               (rules_.late_in_a_row() == 0 || ahead_);
      rules_.late_row(here(), row.t, previous_, newest, taken);
      if (ahead_ && rules_.late_in_a_row() >= kSure) {
        order_.drop_newest();
        rules_.forget_run();
      }
    }
    previous_ = row.t;
  }

  bool read(Row& row) {
    for (;;) {
      while (next_ < piece_.size()) {
        row = piece_[next_++];
        const bool good = check_.good(row);
        if (!good) rules_.bad_row(next_ - 1, check_.explain(row));
        rules_.count_row();
        if (good && skip_ > 0) {
          --skip_;
          continue;
        }
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
  }

  void give(const Row& row, Row& out) {
    constexpr Time kNone = std::numeric_limits<Time>::min();
    if (given_ != kNone) rules_.check_jump(here(), given_, row.t);
    out = row;
    given_ = out.t;
  }

  void put_late(const Row& row) {
    rules_.late_row(here(), row.t, previous_, held_row_.t, false);
    // One stamp ahead of its neighbours on both sides: it is that one that is wrong.
    constexpr Time kGlitch = 1'000'000;
    if (previous_ == held_row_.t && held_row_.t - row.t > kGlitch && row.t >= given_) {
      hold(row);
      rules_.forget_run();
    }
    previous_ = row.t;
  }

  std::unique_ptr<RowSource<Row>> source_;
  InputCheck<Row> check_;
  RowRules rules_;
  std::span<const Row> piece_;
  std::size_t next_ = 0;  // row of the piece to be read next
  std::size_t skip_;
  Row held_row_{};  // read, but not given out before the next row confirms its stamp
  bool held_ = false;
  ImuOrder order_;  // of IMU rows, in place of held_row_
  bool ahead_ =
      false;  // the newest IMU row's stamp lies ahead of all since, which are in order with those before
  bool over_ = false;
  Time given_ = std::numeric_limits<Time>::min();  // stamp of the last row given out
  Time previous_ = 0;                              // stamp of the last row of the file, used or not
  std::string given_at_;  // place of the IMU row that has the stamp of the one before
  std::exception_ptr damage_;
};

/// Rows at the beginning of a stream from before its clock was set.
struct RowsBeforeClock {
  std::size_t rows = 0;
  Time first = 0, last = 0;  ///< of theirs
  Time next = 0;             ///< of the first row behind them
};

/// Looks at the first rows of a pass of its own: a few of them that are stamped minutes away from those
/// behind, which go on in order, are from before the clock was set. Nothing if there are none.
template <class Row>
std::optional<RowsBeforeClock> rows_before_clock(RowSource<Row>& source, const InputCheck<Row>& check) {
  constexpr std::size_t kMost = std::is_same_v<Row, ImuSample> ? 2000 : 40000;
  constexpr Time kJump = 60'000'000'000;
  const auto apart = [](Time a, Time b) { return a > b + kJump || b > a + kJump; };
  RowsBeforeClock found;
  std::size_t rows = 0;
  Time first = 0, previous = 0;
  while (rows < kMost) {
    const std::span<const Row> piece = source.read();
    if (piece.empty() && source.odd().status == RowStatus::kGood) break;
    for (const Row& row : piece) {
      if (!check.good(row)) continue;
      if (rows == 0) first = row.t;
      if (rows > 0 && apart(row.t, previous)) found = {rows, first, previous, row.t};
      previous = row.t;
      ++rows;
    }
  }
  // More than a tenth is no beginning; and a single wild stamp leaves both sides by one clock.
  constexpr std::size_t kFew = 20;
  const bool few =
      found.rows > 0 && 2 * found.rows <= rows && (found.rows <= kFew || 10 * found.rows <= rows);
  if (!few || (!apart(first, found.next) && !apart(first, previous))) return std::nullopt;
  return found;
}

}  // namespace idol
