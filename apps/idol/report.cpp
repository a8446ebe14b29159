#include "idol/report/report.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/report/figures.hpp"
#include "idol/report/run_folder.hpp"

namespace idol::cli {
namespace {

namespace fs = std::filesystem;

struct ReportArguments {
  fs::path dir, pdf, svg, png;
  FigureOptions figures;
};

int report(const ReportArguments& arguments) {
  std::vector<std::pair<fs::path, FigureFormat>> files;
  for (const auto& [file, format] :
       {std::pair{arguments.pdf, FigureFormat::kPdf}, std::pair{arguments.svg, FigureFormat::kSvg},
        std::pair{arguments.png, FigureFormat::kPng}})
    if (!file.empty()) files.emplace_back(file, format);
  if (files.empty() && (!arguments.figures.figures.empty() || arguments.figures.width_mm > 0))
    throw UsageError("--figure and --width need --pdf, --svg or --png FILE");
  if (files.empty()) {
    write_report(arguments.dir);
    fmt::print("{}\n", (arguments.dir / "report.html").string());
  }
  InputPaths inputs;
  for (const char* name : kRunFiles) inputs.add(arguments.dir / name);
  for (const auto& [file, format] : files) inputs.refuse_output(file);
  std::vector<std::string> left_out;
  for (const auto& [file, format] : files) {
    FigureOptions options = arguments.figures;
    options.format = format;
    const FigureFiles done = write_figures(arguments.dir, file, options);
    for (const fs::path& path : done.written) fmt::print("{}\n", path.string());
    left_out = done.left_out;
  }
  for (const std::string& reason : left_out) fmt::print(stderr, "idol: {}\n", reason);
  return 0;
}

}  // namespace

void add_report(CLI::App& app, Action& action) {
  auto* command =
      app.add_subcommand("report", "Make report.html of a run's folder anew, or figures for papers");
  auto a = std::make_shared<ReportArguments>();
  command->add_option("DIR", a->dir, "Folder that 'idol run --out' wrote to")->required();
  command->add_option("--pdf", a->pdf, "Write figures to FILE, one a page")->type_name("FILE");
  command
      ->add_option("--svg", a->svg,
                   "Write figures as SVG; of several, each to FILE with _NAME before its ending")
      ->type_name("FILE");
  command->add_option("--png", a->png, "Write figures as PNG, likewise")->type_name("FILE");
  command
      ->add_option("--figure", a->figures.figures,
                   "Only this figure, as wide as a paper's column; may be repeated")
      ->type_name("NAME")
      ->allow_extra_args(false)
      ->expected(1, CLI::detail::expected_max_vector_size);
  command
      ->add_option("--width", a->figures.width_mm,
                   "Width of the figures (default: 88 for one, 180 for several)")
      ->type_name("MM")
      ->check(CLI::Range(40, 1000));
  command->add_option("--dpi", a->figures.dpi, "Pixels an inch of a PNG")
      ->capture_default_str()
      ->check(CLI::Range(50, 1200));
  std::string names = "Figures:\n";
  for (const FigureName& figure : figure_names())
    names += fmt::format("  {:<12} {}\n", figure.name, figure.what);
  command->footer(names +
                  "Examples:\n  idol report out\n  idol report out --pdf figures.pdf\n"
                  "  idol report out --figure trajectory --pdf trajectory.pdf");
  command->callback([=, &action] { action = [=] { return report(*a); }; });
}

}  // namespace idol::cli
