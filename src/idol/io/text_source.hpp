// The rows of a text file, one a line.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"
#include "idol/io/row_source.hpp"

namespace idol {

/// `Parser` turns a line into a Row: parse(line, row) for its usual form, explain(line, row) for any.
template <class Row, class Parser>
class TextSource : public RowSource<Row> {
 public:
  /// Throws DataError if the file cannot be opened.
  /// The first `skip` lines that are no comments are no rows.
  TextSource(const std::filesystem::path& path, Parser parser, std::size_t skip)
      : lines_(path), parser_(std::move(parser)), skip_(skip) {}

  std::span<const Row> read() override {
    std::string_view line;
    while (lines_.next(line)) {
      if (skip_ > 0) {
        if (!is_blank_or_comment(line)) --skip_;
        continue;
      }
      if (parser_.parse(line, row_)) return {&row_, 1};
      odd_ = parser_.explain(line, row_);
      if (odd_.status == RowStatus::kNothing) continue;
      if (odd_.status == RowStatus::kGood) return {&row_, 1};
      if (lines_.torn() && (odd_.status == RowStatus::kColumns || odd_.status == RowStatus::kBroken))
        odd_.status = RowStatus::kTorn;
      return {};
    }
    odd_ = {};
    return {};
  }
  [[nodiscard]] const RowResult& odd() const override { return odd_; }
  [[nodiscard]] const std::string& name() const override { return lines_.name(); }
  [[nodiscard]] std::string where(std::size_t) const override { return lines_.where(); }
  [[nodiscard]] double progress() const override { return lines_.progress(); }

 private:
  LineReader lines_;
  Parser parser_;
  std::size_t skip_;
  Row row_{};
  RowResult odd_;
};

}  // namespace idol
