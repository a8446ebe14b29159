// The rows of one text file as a clean stream in time order: what is rare is skipped and counted, what is not
// is an error.
#pragma once

#include <cstdint>
#include <exception>
#include <filesystem>
#include <limits>
#include <string>
#include <utility>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/rows.hpp"

namespace idol {

/// The rules by which odd rows are skipped (and counted in Diagnostics) or refused (DataError).
class RowRules {
 public:
  RowRules(const char* row_name, Diagnostics& diagnostics) : row_name_(row_name), diagnostics_(diagnostics) {}

  /// Judges a row that could not be used; returns if it may be skipped.
  void bad_row(const LineReader& lines, const RowResult& row);
  /// A row earlier than (or, for the IMU, as late as) the one before it in the file.
  void late_row(const LineReader& lines, Time t, Time previous, Time newest);
  /// A row that was used, or that was bad.
  void count_row(const LineReader& lines) {
    if (++rows_ == next_check_) check_early(lines);
  }
  /// A row in order that comes long after the one before it.
  void check_jump(const LineReader& lines, Time previous, Time t) const;
  /// A row in order: late rows before it were a passing matter.
  void in_order() { late_in_a_row_ = 0; }
  /// At the end of the stream: the share of bad rows must be small.
  void check_share(const LineReader& lines) const;

 private:
  void check_early(const LineReader& lines);
  void refuse_share(const LineReader& lines) const;

  const char* row_name_;
  Diagnostics& diagnostics_;
  std::int64_t rows_ = 0;
  std::int64_t next_check_ = 10000;
  std::int64_t not_finite_ = 0;
  std::int64_t outside_ = 0;
  std::int64_t jumps_back_ = 0;
  std::int64_t late_in_a_row_ = 0;
  std::string first_bad_;
};

template <class Parser>
class RowStream {
 public:
  using Row = typename Parser::Row;

  /// Throws DataError if the file cannot be opened. `diagnostics` must outlive the stream.
  RowStream(const std::filesystem::path& path, Parser parser, Diagnostics& diagnostics)
      : lines_(path), parser_(std::move(parser)), rules_(Parser::kName, diagnostics) {}

  /// The next row, none earlier than the one before; false at the end. Throws DataError on damage, after all
  /// rows before it were given out.
  bool next(Row& out) {
    if (damage_) std::rethrow_exception(damage_);
    try {
      Row row;
      while (read(row)) {
        if (!held_) {
          hold(row);
        } else if (row.t > held_row_.t || (Parser::kEqualStampsAllowed && row.t == held_row_.t)) {
          give(out);
          held_row_ = row;
          previous_ = row.t;
          rules_.in_order();
          return true;
        } else {
          put_late(row);
        }
      }
      if (!held_) rules_.check_share(lines_);
    } catch (const DataError&) {
      if (!held_) throw;
      damage_ = std::current_exception();
    }
    if (!held_) return false;
    held_ = false;
    give(out);
    return true;
  }

  [[nodiscard]] const LineReader& lines() const { return lines_; }
  /// For a stream that is not read to its end. Throws DataError.
  void check_share() const { rules_.check_share(lines_); }

 private:
  bool read(Row& row) {
    std::string_view line;
    while (lines_.next(line)) {
      if (!parser_.parse(line, row)) {
        const RowResult result = parser_.explain(line, row);
        if (result.status == RowStatus::kNothing) continue;
        if (result.status != RowStatus::kGood) {
          rules_.bad_row(lines_, result);
          rules_.count_row(lines_);
          continue;
        }
      }
      rules_.count_row(lines_);
      return true;
    }
    return false;
  }

  void hold(const Row& row) {
    held_row_ = row;
    held_ = true;
    previous_ = row.t;
  }

  void give(Row& out) {
    constexpr Time kNone = std::numeric_limits<Time>::min();
    if (given_ != kNone) rules_.check_jump(lines_, given_, held_row_.t);
    out = held_row_;
    given_ = out.t;
  }

  void put_late(const Row& row) {
    rules_.late_row(lines_, row.t, previous_, held_row_.t);
    // One stamp ahead of its neighbours on both sides: it is that one that is wrong.
    constexpr Time kGlitch = 1'000'000;
    if (previous_ == held_row_.t && held_row_.t - row.t > kGlitch && row.t >= given_) held_row_ = row;
    previous_ = row.t;
  }

  LineReader lines_;
  Parser parser_;
  RowRules rules_;
  Row held_row_{};  // read, but not given out before the next row confirms its stamp
  bool held_ = false;
  Time given_ = std::numeric_limits<Time>::min();  // stamp of the last row given out
  Time previous_ = 0;                              // stamp of the last row of the file, used or not
  std::exception_ptr damage_;
};

}  // namespace idol
