#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/eval/evaluation_input.hpp"
#include "idol/eval/evaluation_output.hpp"
#include "idol/eval/time_offset.hpp"
#include "idol/io/number.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/text_writer.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::string estimate;
  std::string groundtruth;
  std::vector<std::string> protocols;
  std::string align;
  std::size_t align_first = 0;
  std::vector<double> align_span;
  double until_s = 0;
  std::string json;
  std::string time_offset;
  bool interpolate = false;
};

/// The estimate by the clock of the truth.
Trajectory by_clock_of(const GroundTruth& truth, Trajectory estimate, const std::string& offset) {
  if (offset.empty()) return estimate;
  Time shift = 0;
  if (offset == "auto") {
    shift = find_time_offset(estimate, truth.trajectory);
    fmt::print("time offset {:.3f} s, found from how both move (t_truth = t_estimate + offset)\n",
               static_cast<double>(shift) / kNsPerS);
  } else {
    const auto stamp = parse_stamp(offset);
    if (!stamp)
      throw UsageError(fmt::format("--time-offset {}: seconds, or 'auto', are expected", printable(offset)));
    shift = *stamp;
  }
  return shifted(std::move(estimate), shift);
}

/// `--protocol` takes all words up to the next option, so a path written after its names lands among them.
void sort_out_paths(Arguments& a) {
  const std::vector<std::string> names = protocol_names();
  std::vector<std::string> paths;
  for (const std::string& path : {a.estimate, a.groundtruth})
    if (!path.empty()) paths.push_back(path);
  std::size_t trailing = 0;
  while (paths.size() + trailing < 2 && trailing < a.protocols.size() &&
         std::find(names.begin(), names.end(), a.protocols[a.protocols.size() - 1 - trailing]) == names.end())
    ++trailing;
  const auto first = a.protocols.end() - static_cast<std::ptrdiff_t>(trailing);
  paths.insert(paths.end(), first, a.protocols.end());
  a.protocols.erase(first, a.protocols.end());
  if (paths.size() < 2)
    throw UsageError(
        "evaluate needs ESTIMATE and GROUNDTRUTH: two trajectory files, or a run's folder and a sequence");
  a.estimate = paths[0];
  a.groundtruth = paths[1];
}

EvaluationOptions evaluation_options(const Arguments& a, const CLI::App& command) {
  EvaluationOptions options;
  options.protocols = a.protocols;
  options.interpolate = a.interpolate;
  if (command.count("--until") > 0) {
    if (!(std::isfinite(a.until_s) && a.until_s >= 0)) throw UsageError("--until needs seconds >= 0");
    options.until_s = a.until_s;
  }
  if (!a.align.empty()) {
    options.custom = Protocol{"custom", *parse_alignment_kind(a.align), {}, {}};
    if (command.count("--align-first") > 0) {
      if (a.align_first == 0) throw UsageError("--align-first needs a number of poses >= 1");
      options.custom->poses.first = a.align_first;
    }
    if (!a.align_span.empty()) {
      if (!(a.align_span[0] <= a.align_span[1])) throw UsageError("--align-span FROM TO needs FROM <= TO");
      options.custom->poses.seconds = {a.align_span[0], a.align_span[1]};
    }
  }
  return options;
}

int evaluate_command(Arguments a, const CLI::App& command) {
  sort_out_paths(a);
  a.estimate = input_path(a.estimate).string();
  a.groundtruth = input_path(a.groundtruth).string();
  const EvaluationOptions options = evaluation_options(a, command);
  const GroundTruth truth = load_groundtruth(a.groundtruth);
  const fs::path estimate_path = estimate_file(a.estimate, truth);
  InputPaths inputs;
  inputs.add(estimate_path);
  inputs.add_files(a.groundtruth);
  inputs.refuse_output(a.json);
  const Trajectory estimate = by_clock_of(truth, load_estimate(estimate_path), a.time_offset);
  Evaluation evaluation;
  try {
    evaluation = evaluate(estimate, truth.trajectory, options);
  } catch (const DataError& e) {
    throw DataError(fmt::format("{} against {}: {}", estimate_path.string(), truth.name, e.what()));
  }
  if (truth.lost > 0)
    fmt::print(stderr, "idol: warning: {}: {} poses that the capture had lost are left out [lost_truth]\n",
               truth.name, truth.lost);
  if (!a.json.empty()) write_text_file(a.json, evaluation_json(evaluation));
  fmt::print("estimate {}\nground truth {}\n{}", estimate_path.string(), truth.name,
             evaluation_text(evaluation));
  return 0;
}

}  // namespace

void add_evaluate(CLI::App& app, Action& action) {
  auto* command = app.add_subcommand("evaluate", "Compare a trajectory with ground truth");
  auto a = std::make_shared<Arguments>();
  command->add_option("ESTIMATE", a->estimate,
                      "Trajectory file, or a run's output folder (its trajectory_camera.txt)");
  command->add_option("GROUNDTRUTH", a->groundtruth,
                      "Trajectory file, or a recording of any format that holds ground truth");
  command->add_option("--protocol", a->protocols,
                      "idol, uslam, hku, full, sim3, segments; without it and --align: all");
  auto* align = command->add_option("--align", a->align, "Free alignment, reported as protocol 'custom'")
                    ->check(CLI::IsMember({"none", "posyaw", "se3", "sim3"}));
  auto* first = command->add_option("--align-first", a->align_first, "Align on the first N matched poses")
                    ->needs(align)
                    ->type_name("N");
  command->add_option("--align-span", a->align_span, "Align on a span of seconds since the estimate's start")
      ->needs(align)
      ->excludes(first)
      ->expected(2)
      ->type_name("FROM TO");
  command->add_option("--until", a->until_s, "Judge only the first S seconds of the estimate")
      ->type_name("S");
  command
      ->add_option("--time-offset", a->time_offset,
                   "Seconds to add to the estimate's stamps; 'auto': found from how both trajectories move")
      ->type_name("S|auto");
  command->add_option("--json", a->json, "Write all figures to FILE")->type_name("FILE");
  command->add_flag("--interpolate", a->interpolate,
                    "Interpolate ground truth at the estimate's stamps instead of taking the nearest pose");
  command->footer(
      "Examples:\n  idol evaluate out shapes_6dof\n  idol evaluate out/trajectory_camera.txt truth.txt "
      "--protocol full");
  command->callback([=, &action] { action = [=] { return evaluate_command(*a, *command); }; });
}

}  // namespace idol::cli
