#include "idol/report/figures.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>

#include "idol/base/diagnostics.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/report/figure_makers.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

constexpr double kColumnMm = 88, kPageMm = 180;
constexpr double kPointsPerMm = 72 / 25.4;

struct Kind {
  FigureName name;
  FigureMaker make;
};

const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all = {
      {{"trajectory", "top view and side view, with ground truth"}, trajectory_figure},
      {{"position", "of the IMU against time, with ground truth and 3-sigma bands"}, position_figure},
      {{"orientation", "roll, pitch and yaw of the IMU, likewise"}, orientation_figure},
      {{"velocity", "of the IMU, likewise"}, velocity_figure},
      {{"bias", "of gyroscope and accelerometer, with 3-sigma bands"}, bias_figure},
      {{"errors", "translation and rotation error against time, causal and smoothed"}, error_figure},
      {{"consistency", "causal errors by axis within their 3-sigma bands"}, consistency_figure},
      {{"segments", "relative errors of protocol 'segments' as box plots"}, segment_figure},
      {{"events", "events of one window coloured by line, the estimated lines over them"}, event_figure},
      {{"map", "lines from above and from the side"}, map_figure},
      {{"health", "event rate, tracks, residuals, computing time, latency"}, health_figure},
  };
  return all;
}

const Kind& find_kind(const std::string& name) {
  for (const Kind& kind : kinds())
    if (kind.name.name == name) return kind;
  std::vector<std::string> names;
  for (const Kind& kind : kinds()) names.push_back(kind.name.name);
  throw UsageError(
      fmt::format("figure '{}' is not known; there are {}", printable(name), fmt::join(names, ", ")));
}

FigureSource read_source(const fs::path& run_dir) {
  FigureSource source;
  source.run = read_run_folder(run_dir);
  const RunFolder& run = source.run;
  source.zero = first_stamp(run).value_or(0);
  if (!run.camera.empty()) source.truth = align_truth(run.camera, run.groundtruth);
  if (!run.camera_causal.empty()) source.causal_truth = align_truth(run.camera_causal, run.groundtruth);
  source.panels = make_panels(run, source.truth, source.causal_truth, source.zero);
  return source;
}

struct Page {
  std::string name;
  Figure figure;
};

std::string draw(const std::vector<Page>& pages, double width, const FigureOptions& options,
                 const fs::path& run_dir) {
  Canvas canvas(
      options.format, options.dpi,
      fmt::format("{}: {}", run_dir.filename().string(), pages.size() == 1 ? pages[0].name : "figures"));
  for (const Page& page : pages) {
    canvas.begin_page(width, page.figure.height, page.name);
    draw_column(canvas, {0, 0, width, page.figure.height}, page.figure.plots);
  }
  return canvas.finish();
}

}  // namespace

const std::vector<FigureName>& figure_names() {
  static const std::vector<FigureName> names = [] {
    std::vector<FigureName> out;
    for (const Kind& kind : kinds()) out.push_back(kind.name);
    return out;
  }();
  return names;
}

FigureFiles write_figures(const fs::path& run_dir, const fs::path& file, const FigureOptions& options) {
  std::vector<Kind> chosen;
  for (const std::string& name : options.figures) chosen.push_back(find_kind(name));
  if (chosen.empty()) chosen = kinds();
  const double width_mm = options.width_mm > 0 ? options.width_mm : chosen.size() == 1 ? kColumnMm : kPageMm;
  const double width = width_mm * kPointsPerMm;
  const FigureSource source = read_source(run_dir);
  FigureFiles files;
  for (const std::string& note : source.run.notes)
    if (note.find("cannot be used") != std::string::npos) files.left_out.push_back(note);
  std::vector<Page> pages;
  for (const Kind& kind : chosen) {
    Figure figure = kind.make(source, width);
    if (figure.plots.empty())
      files.left_out.push_back(
          fmt::format("figure '{}' is left out: it needs {}", kind.name.name, figure.needs));
    else
      pages.push_back({kind.name.name, std::move(figure)});
  }
  if (pages.empty())
    throw DataError(fmt::format("{}: {}", run_dir.string(), fmt::join(files.left_out, "; ")));
  const auto write = [&](const fs::path& path, const std::vector<Page>& content) {
    write_text_file(path, draw(content, width, options, run_dir));
    files.written.push_back(path);
  };
  if (options.format == FigureFormat::kPdf || chosen.size() == 1) {
    write(file, pages);
    return files;
  }
  for (const Page& page : pages) {
    fs::path path = file;
    path.replace_filename(fmt::format("{}_{}{}", file.stem().string(), page.name, file.extension().string()));
    write(path, {page});
  }
  return files;
}

}  // namespace idol
