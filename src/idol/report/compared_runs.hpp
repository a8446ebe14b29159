// Runs found on disk, with what identifies them and all figures that can be compared.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace idol {

enum class FigureSourceKind { kSmoothed, kCausal, kRun };

/// A figure of a run.
struct ComparedFigure {
  std::string key, group, title;
  FigureSourceKind source;
  std::string path;  ///< JSON pointer into the evaluation, or into stats.json
  double factor;
  int digits;
  int better;            ///< -1: small, 1: large, 0: neither
  bool by_default;       ///< shown unless others are asked for (and some run has it)
  bool gated;            ///< an RMSE that a regression is judged by
  bool averaged = true;  ///< has a geometric mean
};

const std::vector<ComparedFigure>& compared_figures();

struct ComparedRun {
  std::filesystem::path dir;  ///< canonical
  std::string recording;      ///< last part of the path in stats.json, without ending
  std::string name;  ///< of the folder; of the folder above where this one is called like the recording
  std::string configuration;  ///< the same for runs with the same options on several recordings
  std::string preset, config_yaml;
  std::string trouble;          ///< why it did not end well
  std::vector<double> figures;  ///< as compared_figures(); NaN: none
};

/// The runs in `dirs`: folders of runs, or folders of such folders. Each is named as shortly as tells it from
/// the others of its recording. Figures are those of evaluation.json and evaluation_causal.json; where these
/// are not there, but ground truth is (groundtruth_camera.txt), the trajectories are judged anew. Throws
/// DataError for a folder without a run, and for damaged files.
std::vector<ComparedRun> find_runs(const std::vector<std::filesystem::path>& dirs);

}  // namespace idol
