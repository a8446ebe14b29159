// A table of figures as text, Markdown, HTML, LaTeX or CSV.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace idol {

struct TableColumn {
  std::string key;    ///< for programs
  std::string group;  ///< first line of the title; may be empty
  std::string title;
  int digits = 2;        ///< after the point
  bool changes = false;  ///< cells have a change beside
};

struct TableCell {
  double value = std::numeric_limits<double>::quiet_NaN();           ///< NaN: none, "-"
  double change_percent = std::numeric_limits<double>::quiet_NaN();  ///< NaN: none
  bool best = false;
};

/// Rows of one group stand together; its name is told once.
struct FiguresRow {
  std::string group;
  std::string name;
  std::string remark;  ///< behind the name, in brackets
  std::vector<TableCell> cells;
};

struct Table {
  std::array<std::string, 2> row_titles;  ///< of groups and of rows
  std::vector<TableColumn> columns;
  std::vector<FiguresRow> rows;
};

enum class TableFormat { kText, kMarkdown, kHtml, kLatex, kCsv };
constexpr std::array<std::string_view, 5> option_names(TableFormat) {
  return {"text", "markdown", "html", "latex", "csv"};
}

/// Markdown, LaTeX (booktabs) and HTML have the best in bold, text marks it with *. HTML is a whole page
/// without anything from outside. CSV has the keys as titles, nine digits, and a column
/// `KEY_change_percent` where there are changes.
std::string table_as(TableFormat format, const Table& table);

}  // namespace idol
