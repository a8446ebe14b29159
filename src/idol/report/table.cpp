#include "idol/report/table.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

namespace idol {
namespace {

std::string number(const TableCell& cell, int digits) {
  return std::isfinite(cell.value) ? fmt::format("{:.{}f}", cell.value, digits) : "-";
}

std::string change(const TableCell& cell) {
  return std::isfinite(cell.change_percent) ? fmt::format("{:+.1f}", cell.change_percent) : "";
}

std::string whole_title(const TableColumn& column) {
  return column.group.empty() ? column.title : column.group + ": " + column.title;
}

std::string whole_name(const FiguresRow& row) {
  return row.remark.empty() ? row.name : fmt::format("{} ({})", row.name, row.remark);
}

/// The group's name where it is new.
std::string group_once(const Table& table, std::size_t row) {
  const std::string& group = table.rows[row].group;
  return row > 0 && table.rows[row - 1].group == group ? "" : group;
}

/// Replaces every character that has an entry in `escapes`.
std::string escaped(std::string_view text, std::initializer_list<std::pair<char, const char*>> escapes) {
  std::string out;
  for (const char c : text) {
    const auto* found =
        std::find_if(escapes.begin(), escapes.end(), [c](const auto& e) { return e.first == c; });
    found == escapes.end() ? out += c : out += found->second;
  }
  return out;
}

/// Letters, not bytes, of UTF-8.
std::size_t letters(std::string_view text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string padded(const std::string& text, std::size_t width, bool right) {
  const std::string room(width - std::min(width, letters(text)), ' ');
  return right ? room + text : text + room;
}

std::string as_text(const Table& table) {
  std::vector<std::vector<std::string>> lines(2);
  for (const std::string& title : table.row_titles) {
    lines[0].emplace_back();
    lines[1].push_back(title);
  }
  for (const TableColumn& column : table.columns) {
    lines[0].push_back(column.group + (column.changes ? "    " : ""));
    lines[1].push_back(column.title + (column.changes ? "   %" : ""));
  }
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    lines.push_back({group_once(table, r), whole_name(table.rows[r])});
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const TableCell& cell = table.rows[r].cells[c];
      std::string text = number(cell, table.columns[c].digits) + (cell.best ? "*" : " ");
      if (table.columns[c].changes) text += padded(change(cell), 7, true);
      lines.back().push_back(text);
    }
  }
  std::vector<std::size_t> widths(lines[0].size());
  for (const auto& line : lines)
    for (std::size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], letters(line[c]));
  std::string text;
  for (std::size_t l = 0; l < lines.size(); ++l) {
    std::string line;
    for (std::size_t c = 0; c < lines[l].size(); ++c) {
      // The mark of the best takes a place, in which titles have nothing.
      const bool right = c >= 2, title = l < 2;
      line += (c > 0 ? "  " : "") +
              padded(lines[l][c] + (right && title ? " " : ""), widths[c] + (right ? 1 : 0), right);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    if (l > 2 && !lines[l][0].empty()) text += '\n';
    text += line + '\n';
  }
  return text;
}

std::string as_markdown(const Table& table) {
  const auto safe = [](std::string_view text) { return escaped(text, {{'|', "\\|"}}); };
  std::string text = "| " + fmt::format("{} | {} |", safe(table.row_titles[0]), safe(table.row_titles[1]));
  std::string rule = "|---|---|";
  for (const TableColumn& column : table.columns) {
    text += " " + safe(whole_title(column)) + " |";
    rule += "--:|";
  }
  text += "\n" + rule + "\n";
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    text += fmt::format("| {} | {} |", safe(group_once(table, r)), safe(whole_name(table.rows[r])));
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const TableCell& cell = table.rows[r].cells[c];
      const std::string value = number(cell, table.columns[c].digits), by = change(cell);
      text += fmt::format(fmt::runtime(cell.best ? " **{}**{} |" : " {}{} |"), value,
                          by.empty() ? "" : " (" + by + " %)");
    }
    text += "\n";
  }
  return text;
}

constexpr const char* kHtmlHead = R"(<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Comparison of runs</title>
<style>
:root { color-scheme: light dark; font: 15px/1.4 system-ui, sans-serif; }
body { margin: 1.5rem; overflow-x: auto; }
table { border-collapse: collapse; }
caption { text-align: left; padding-bottom: .5rem; }
th, td { padding: .2rem .7rem; text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
thead th { white-space: normal; vertical-align: bottom; border-bottom: 2px solid; }
th:nth-child(-n+2), tbody th { text-align: left; }
tbody tr:first-child > * { border-top: 1px solid #8888; }
small { opacity: .75; }
</style>
)";

std::string as_html(const Table& table) {
  const auto safe = [](std::string_view text) {
    return escaped(text, {{'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}});
  };
  std::string text = fmt::format("{}<table>\n<caption>The best of each {} in bold</caption>\n<thead><tr>",
                                 kHtmlHead, safe(table.row_titles[0]));
  for (const std::string& title : table.row_titles)
    text += fmt::format("<th scope=\"col\">{}</th>", safe(title));
  for (const TableColumn& column : table.columns)
    text += fmt::format("<th scope=\"col\">{}</th>", safe(whole_title(column)));
  text += "</tr></thead>\n";
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const std::string group = group_once(table, r);
    if (!group.empty()) text += "<tbody>\n";
    text += fmt::format("<tr><th scope=\"rowgroup\">{}</th><th scope=\"row\">{}</th>", safe(group),
                        safe(whole_name(table.rows[r])));
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const TableCell& cell = table.rows[r].cells[c];
      const std::string value = number(cell, table.columns[c].digits), by = change(cell);
      text += fmt::format(fmt::runtime(cell.best ? "<td><b>{}</b>{}</td>" : "<td>{}{}</td>"), value,
                          by.empty() ? "" : " <small>" + by + " %</small>");
    }
    text += "</tr>\n";
  }
  return text + "</table>\n</html>\n";
}

std::string as_latex(const Table& table) {
  const auto safe = [](std::string_view text) {
    return escaped(text, {{'\\', "\\textbackslash{}"},
                          {'&', "\\&"},
                          {'%', "\\%"},
                          {'$', "\\$"},
                          {'#', "\\#"},
                          {'_', "\\_"},
                          {'{', "\\{"},
                          {'}', "\\}"},
                          {'~', "\\textasciitilde{}"},
                          {'^', "\\textasciicircum{}"}});
  };
  std::string columns, groups, titles;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const TableColumn& column = table.columns[c];
    const int width = column.changes ? 2 : 1;
    columns.append(static_cast<std::size_t>(width), 'r');
    titles += width == 1 ? " & " + safe(column.title)
                         : fmt::format(" & \\multicolumn{{2}}{{r}}{{{}}}", safe(column.title));
    if (c > 0 && table.columns[c - 1].group == column.group) continue;
    int span = 0;  // of neighbours with one group
    for (std::size_t k = c; k < table.columns.size() && table.columns[k].group == column.group; ++k)
      span += width;
    groups +=
        fmt::format(" & \\multicolumn{{{}}}{{{}}}{{{}}}", span, span > width ? 'c' : 'r', safe(column.group));
  }
  std::string text = fmt::format(
      "% needs \\usepackage{{booktabs}}\n\\begin{{tabular}}{{ll{}}}\n\\toprule\n &{} \\\\\n{} & {}{} \\\\\n",
      columns, groups, safe(table.row_titles[0]), safe(table.row_titles[1]), titles);
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const std::string group = group_once(table, r);
    if (!group.empty()) text += "\\midrule\n";
    text += fmt::format("{} & {}", safe(group), safe(whole_name(table.rows[r])));
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const TableCell& cell = table.rows[r].cells[c];
      const std::string value = std::isfinite(cell.value) ? number(cell, table.columns[c].digits) : "--";
      text += fmt::format(fmt::runtime(cell.best ? " & \\textbf{{{}}}" : " & {}"), value);
      const std::string by = change(cell);
      if (table.columns[c].changes) text += by.empty() ? " & " : fmt::format(" & ${}$\\,\\%", by);
    }
    text += " \\\\\n";
  }
  return text + "\\bottomrule\n\\end{tabular}\n";
}

std::string as_csv(const Table& table) {
  const auto quoted = [](std::string_view text) {
    return text.find_first_of(",\"\n") == std::string_view::npos ? std::string(text)
                                                                 : '"' + escaped(text, {{'"', "\"\""}}) + '"';
  };
  const auto plain = [](double v) { return std::isfinite(v) ? fmt::format("{:.9g}", v) : std::string(); };
  std::string text = fmt::format("{},{},remark", quoted(table.row_titles[0]), quoted(table.row_titles[1]));
  for (const TableColumn& column : table.columns)
    text += "," + column.key + (column.changes ? "," + column.key + "_change_percent" : "");
  text += "\n";
  for (const FiguresRow& row : table.rows) {
    text += fmt::format("{},{},{}", quoted(row.group), quoted(row.name), quoted(row.remark));
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      text += "," + plain(row.cells[c].value);
      if (table.columns[c].changes) text += "," + plain(row.cells[c].change_percent);
    }
    text += "\n";
  }
  return text;
}

}  // namespace

std::string table_as(TableFormat format, const Table& table) {
  switch (format) {
    case TableFormat::kMarkdown:
      return as_markdown(table);
    case TableFormat::kHtml:
      return as_html(table);
    case TableFormat::kLatex:
      return as_latex(table);
    case TableFormat::kCsv:
      return as_csv(table);
    case TableFormat::kText:
      break;
  }
  return as_text(table);
}

}  // namespace idol
