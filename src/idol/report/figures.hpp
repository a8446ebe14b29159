// Figures for papers, made of a run's folder: vector PDF or SVG, or PNG.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "idol/report/canvas.hpp"

namespace idol {

/// A figure that can be asked for.
struct FigureName {
  std::string name;
  std::string what;  ///< one line
};

/// All of them, in the order of a PDF's pages.
const std::vector<FigureName>& figure_names();

struct FigureOptions {
  FigureFormat format = FigureFormat::kPdf;
  std::vector<std::string> figures;  ///< names; none: all
  double width_mm = 0;               ///< 0: a paper's column (88 mm) for one figure, 180 mm for several
  double dpi = 300;                  ///< of a PNG
};

/// What came of it.
struct FigureFiles {
  std::vector<std::filesystem::path> written;
  std::vector<std::string> left_out;  ///< damaged files, and why figures are not there
};

/// Writes figures of the run in `run_dir`: one PDF with a page each, or a file each (of several: `file` with
/// "_NAME" before its ending). A figure whose data are missing is left out. Throws UsageError for an unknown
/// name, DataError when the folder holds nothing of a run, none of the figures can be made, or the disk
/// refuses.
FigureFiles write_figures(const std::filesystem::path& run_dir, const std::filesystem::path& file,
                          const FigureOptions& options);

}  // namespace idol
