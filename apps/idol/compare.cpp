#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"
#include "idol/base/options.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/report/compared_runs.hpp"
#include "idol/report/comparison.hpp"
#include "idol/report/run_folder.hpp"

namespace idol::cli {
namespace {

struct CompareArguments {
  std::vector<std::filesystem::path> dirs;
  ComparisonOptions options;
  double fail_above = 0;
  std::string format;
  std::filesystem::path out;
};

/// Without --format, by the file's ending.
TableFormat table_format(const CompareArguments& a) {
  TableFormat format = TableFormat::kText;
  if (!a.format.empty()) {
    detail::parse_option(a.format, {}, format);
    return format;
  }
  const std::string ending = a.out.extension();
  return ending == ".html"  ? TableFormat::kHtml
         : ending == ".tex" ? TableFormat::kLatex
         : ending == ".csv" ? TableFormat::kCsv
         : ending == ".md"  ? TableFormat::kMarkdown
                            : format;
}

int compare(const CompareArguments& a) {
  const TableFormat format = table_format(a);
  if (!a.out.empty() && std::filesystem::exists(a.out)) {
    InputPaths inputs;
    for (const std::filesystem::path& dir : a.dirs)
      for (const char* name : kRunFiles) inputs.add(dir / name);
    inputs.refuse_output(a.out);
  }
  const Comparison comparison = compare_runs(a.dirs, a.options);
  const std::string text = table_as(format, comparison.table);
  if (a.out.empty())
    fmt::print("{}", text);
  else
    write_text_file(a.out, text);
  for (const std::string& remark : comparison.remarks) fmt::print(stderr, "idol: {}\n", remark);
  for (const std::string& regression : comparison.regressions)
    fmt::print(stderr, "idol: worse: {}\n", regression);
  return comparison.regressions.empty() ? 0 : 1;
}

}  // namespace

void add_compare(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("compare", "A table of runs, by recording");
  auto a = std::make_shared<CompareArguments>();
  command
      ->add_option("DIR", a->dirs,
                   "Folders that 'idol run --out' wrote to, or folders that hold some of these")
      ->required();
  command->add_option("--figures", a->options.figures, "Columns, parted by commas; names below")
      ->type_name("A,B,C")
      ->delimiter(',')
      ->allow_extra_args(false);
  auto* baseline = command
                       ->add_option("--baseline", a->options.baseline,
                                    "Show changes against this run or folder of runs, recording by recording")
                       ->type_name("DIR|NAME");
  command
      ->add_option("--fail-above", a->fail_above,
                   "Exit with 1 if an RMSE of protocol full is worse than the baseline's by more than this")
      ->type_name("PERCENT")
      ->needs(baseline)
      ->check(CLI::NonNegativeNumber);
  command
      ->add_option("--format", a->format,
                   "text, markdown, html, latex or csv (default: by FILE's ending, else text)")
      ->check(CLI::IsMember({"text", "markdown", "html", "latex", "csv"}));
  command->add_option("--out", a->out, "Write to FILE instead of standard output")->type_name("FILE");
  std::string names = "Figures, those shown without --figures marked with +:\n";
  for (const ComparedFigure& figure : compared_figures())
    names += fmt::format("  {} {:<26} {}{}{}\n", figure.by_default ? '+' : ' ', figure.key, figure.group,
                         figure.group.empty() ? "" : ": ", figure.title);
  command->footer(
      names +
      "Examples:\n  idol compare out/realtime out/paper\n"
      "  idol compare new --baseline old --fail-above 10\n"
      "  idol compare out/* --figures causal_full_rmse,full_rmse,realtime_factor --out table.tex");
  command->callback([=, &action] {
    action = [=] {
      if (command->count("--fail-above") > 0) a->options.fail_above = a->fail_above;
      return compare(*a);
    };
  });
}

}  // namespace idol::cli
