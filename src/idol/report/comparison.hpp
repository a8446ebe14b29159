// Runs side by side, by recording: for papers, ablations, and regressions in CI.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "idol/report/table.hpp"

namespace idol {

struct ComparisonOptions {
  std::vector<std::string> figures;  ///< keys of compared_figures(); none: the usual ones that some run has
  std::string baseline;              ///< a folder of runs, or a run's name; empty: none
  std::optional<double> fail_above;  ///< [%]; needs a baseline
};

struct Comparison {
  Table table;
  std::vector<std::string> remarks;      ///< about runs that did not end well
  std::vector<std::string> regressions;  ///< in words; only with `fail_above`
};

/// Compares the runs in `dirs` (folders of runs, or folders of such folders). A group of rows for each
/// recording, then geometric means of the configurations that were run on several recordings, over those that
/// all of them have. With a baseline, each figure's change against the baseline's run of the same recording.
/// With `fail_above`, regressions: an RMSE of protocol `full` that is worse by more than that or is not there
/// any more, a run that did not end well, a recording that only the baseline has. Throws UsageError for
/// unknown figures or an unknown baseline, DataError for folders without runs.
Comparison compare_runs(const std::vector<std::filesystem::path>& dirs, const ComparisonOptions& options);

}  // namespace idol
