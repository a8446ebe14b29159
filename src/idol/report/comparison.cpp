#include "idol/report/comparison.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "idol/base/diagnostics.hpp"
#include "idol/report/compared_runs.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

using RunsByRecording = std::map<std::string, const ComparedRun*>;

/// Indices into compared_figures().
std::vector<std::size_t> chosen_figures(const std::vector<std::string>& keys,
                                        const std::vector<ComparedRun>& runs) {
  const auto& all = compared_figures();
  std::vector<std::size_t> chosen;
  for (const std::string& key : keys) {
    const auto found =
        std::find_if(all.begin(), all.end(), [&](const ComparedFigure& f) { return f.key == key; });
    if (found == all.end()) {
      std::vector<std::string> names;
      for (const ComparedFigure& figure : all) names.push_back(figure.key);
      throw UsageError(
          fmt::format("figure '{}' is not known; there are {}", printable(key), fmt::join(names, ", ")));
    }
    chosen.push_back(static_cast<std::size_t>(found - all.begin()));
  }
  if (!keys.empty()) return chosen;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto has = [i](const ComparedRun& run) { return std::isfinite(run.figures[i]); };
    if (all[i].by_default && std::any_of(runs.begin(), runs.end(), has)) chosen.push_back(i);
  }
  return chosen;
}

/// The baseline's run of each recording.
RunsByRecording baseline_runs(const std::string& baseline, const std::vector<ComparedRun>& runs) {
  RunsByRecording found;
  if (baseline.empty()) return found;
  std::set<fs::path> dirs;
  if (fs::is_directory(baseline))
    for (const ComparedRun& run : find_runs({baseline})) dirs.insert(run.dir);
  for (const ComparedRun& run : runs) {
    if (dirs.empty() ? run.name != baseline : dirs.count(run.dir) == 0) continue;
    if (!found.emplace(run.recording, &run).second)
      throw UsageError(
          fmt::format("baseline '{}' has several runs of recording '{}'; give a folder with one of each",
                      printable(baseline), run.recording));
  }
  if (!found.empty()) return found;
  std::set<std::string> names;
  for (const ComparedRun& run : runs) names.insert(run.name);
  throw UsageError(fmt::format("baseline '{}' is neither a folder nor the name of a run; names are {}",
                               printable(baseline), fmt::join(names, ", ")));
}

double change_percent(double value, double base) {
  return base != 0 ? 100 * (value / base - 1) : std::numeric_limits<double>::quiet_NaN();
}

FiguresRow row_of(const std::string& group, const std::string& name, const std::vector<double>& figures,
                  const std::vector<double>* baseline, const std::vector<std::size_t>& chosen) {
  FiguresRow row{group, name, {}, {}};
  for (const std::size_t i : chosen) {
    TableCell cell{.value = figures[i]};
    if (baseline != nullptr && baseline != &figures)
      cell.change_percent = change_percent(figures[i], (*baseline)[i]);
    row.cells.push_back(cell);
  }
  return row;
}

/// Marks the best of rows [begin, end), and those that look the same as it in print.
void mark_best(Table& table, std::size_t begin, const std::vector<std::size_t>& chosen) {
  if (table.rows.size() < begin + 2) return;
  for (std::size_t c = 0; c < chosen.size(); ++c) {
    const ComparedFigure& figure = compared_figures()[chosen[c]];
    const auto printed = [&](double v) {
      return figure.better * std::round(v * std::pow(10.0, figure.digits));
    };
    double best = -std::numeric_limits<double>::infinity(), worst = -best;
    for (std::size_t r = begin; r < table.rows.size(); ++r) {
      best = std::fmax(best, printed(table.rows[r].cells[c].value));
      worst = std::fmin(worst, printed(table.rows[r].cells[c].value));
    }
    if (figure.better == 0 || best == worst) continue;
    for (std::size_t r = begin; r < table.rows.size(); ++r)
      table.rows[r].cells[c].best = printed(table.rows[r].cells[c].value) == best;
  }
}

/// Configurations in the order they first appear, each with its run of each recording.
std::vector<std::pair<std::string, RunsByRecording>> configurations(const std::vector<ComparedRun>& runs) {
  std::vector<std::pair<std::string, RunsByRecording>> list;
  for (const ComparedRun& run : runs) {
    auto found =
        std::find_if(list.begin(), list.end(), [&](const auto& c) { return c.first == run.configuration; });
    if (found == list.end()) found = list.insert(list.end(), {run.configuration, {}});
    found->second.emplace(run.recording, &run);
  }
  std::erase_if(list, [](const auto& c) { return c.second.size() < 2; });
  return list;
}

/// NaN where the figure has none, or a run lacks it.
std::vector<double> geometric_means(const RunsByRecording& runs, const std::vector<std::string>& recordings) {
  std::vector<double> means;
  for (std::size_t i = 0; i < compared_figures().size(); ++i) {
    double sum = 0;
    for (const std::string& recording : recordings) sum += std::log(runs.at(recording)->figures[i]);
    means.push_back(compared_figures()[i].averaged ? std::exp(sum / static_cast<double>(recordings.size()))
                                                   : std::numeric_limits<double>::quiet_NaN());
  }
  return means;
}

void add_means(Table& table, const std::vector<ComparedRun>& runs, const RunsByRecording& baseline,
               const std::vector<std::size_t>& chosen) {
  const auto list = configurations(runs);
  if (list.empty()) return;
  std::vector<std::string> shared;
  for (const auto& [recording, run] : list.front().second)
    if (std::all_of(list.begin(), list.end(), [&](const auto& c) { return c.second.count(recording) > 0; }))
      shared.push_back(recording);
  if (shared.size() < 2) return;
  std::vector<std::vector<double>> means;
  const std::vector<double>* base = nullptr;
  means.reserve(list.size());
  for (const auto& [name, members] : list) {
    means.push_back(geometric_means(members, shared));
    if (baseline.count(shared.front()) > 0 && baseline.at(shared.front())->configuration == name)
      base = &means.back();
  }
  const std::size_t begin = table.rows.size();
  for (std::size_t k = 0; k < list.size(); ++k)
    table.rows.push_back(
        row_of(fmt::format("geometric mean of {}", shared.size()), list[k].first, means[k], base, chosen));
  mark_best(table, begin, chosen);
}

std::vector<std::string> regressions_of(const std::vector<ComparedRun>& runs, const RunsByRecording& baseline,
                                        double fail_above) {
  std::vector<std::string> found;
  std::set<std::string> compared;
  for (const ComparedRun& run : runs) {
    const auto base = baseline.find(run.recording);
    if (base == baseline.end() || base->second == &run) continue;
    compared.insert(run.recording);
    const std::string who = fmt::format("{}, {}", run.recording, run.name);
    if (!run.trouble.empty()) found.push_back(fmt::format("{}: {}", who, run.trouble));
    for (std::size_t i = 0; i < compared_figures().size(); ++i) {
      const ComparedFigure& figure = compared_figures()[i];
      const double value = run.figures[i], before = base->second->figures[i];
      if (!figure.gated || !std::isfinite(before)) continue;
      const std::string what = fmt::format("{}: {} {}", who, figure.group, figure.title);
      if (!std::isfinite(value))
        found.push_back(fmt::format("{} is not there; it was {:.{}f}", what, before, figure.digits));
      else if (value > before * (1 + fail_above / 100))
        found.push_back(fmt::format("{} {:.{}f} instead of {:.{}f}, {:+.1f} %, more than {:g} %", what, value,
                                    figure.digits, before, figure.digits, change_percent(value, before),
                                    fail_above));
    }
  }
  for (const auto& [recording, run] : baseline)
    if (compared.count(recording) == 0)
      found.push_back(fmt::format("{}: only the baseline has a run of it", recording));
  return found;
}

}  // namespace

Comparison compare_runs(const std::vector<fs::path>& given, const ComparisonOptions& options) {
  if (options.fail_above && options.baseline.empty())
    throw UsageError("a limit of regressions needs a baseline");
  std::vector<fs::path> dirs = given;
  if (fs::is_directory(options.baseline)) dirs.insert(dirs.begin(), options.baseline);
  const std::vector<ComparedRun> runs = find_runs(dirs);
  const std::vector<std::size_t> chosen = chosen_figures(options.figures, runs);
  const RunsByRecording baseline = baseline_runs(options.baseline, runs);
  Comparison out;
  out.table.row_titles = {"recording", "run"};
  for (const std::size_t i : chosen) {
    const ComparedFigure& f = compared_figures()[i];
    out.table.columns.push_back({f.key, f.group, f.title, f.digits, !baseline.empty()});
  }
  std::set<std::string> recordings;
  for (const ComparedRun& run : runs) recordings.insert(run.recording);
  for (const std::string& recording : recordings) {
    const std::size_t begin = out.table.rows.size();
    const auto base = baseline.find(recording);
    for (const ComparedRun& run : runs) {
      if (run.recording != recording) continue;
      out.table.rows.push_back(row_of(recording, run.name, run.figures,
                                      base == baseline.end() ? nullptr : &base->second->figures, chosen));
      if (!run.trouble.empty()) {
        out.table.rows.back().remark = "see below";
        out.remarks.push_back(fmt::format("{}, {}: {}", recording, run.name, run.trouble));
      }
    }
    mark_best(out.table, begin, chosen);
  }
  add_means(out.table, runs, baseline, chosen);
  if (options.fail_above) out.regressions = regressions_of(runs, baseline, *options.fail_above);
  return out;
}

}  // namespace idol
