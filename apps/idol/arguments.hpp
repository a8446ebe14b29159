// Arguments that several subcommands share.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "idol/io/recording.hpp"
#include "idol/odometry/odometry.hpp"

namespace idol::cli {

/// --preset, --config and --set, applied in this order.
struct OptionArguments {
  std::string preset = "realtime";
  std::string config;
  std::vector<std::string> set;

  void declare(CLI::App& command);
  /// Throws UsageError on an unknown preset or key, a bad value, or an unreadable file.
  [[nodiscard]] Options resolve() const;
};

/// --from and --to [s from the recording's first stamp].
struct SpanArguments {
  double from_s = 0;
  double to_s = 1e30;

  void declare(CLI::App& command);
};

/// Which streams of a recording: --events-topic, --imu-topic, --truth-topic and --imu.
struct StreamArguments {
  StreamChoice choice;

  void declare(CLI::App& command);
};

/// --rig and --imu-rig.
struct RigArguments {
  std::filesystem::path rig, imu_rig;

  void declare(CLI::App& command);
  [[nodiscard]] bool given() const { return !rig.empty() || !imu_rig.empty(); }
  /// The rig of a recording, as far as it is known. Throws DataError.
  [[nodiscard]] Rig known(const std::filesystem::path& sequence) const {
    return load_rig(sequence, rig, imu_rig);
  }
  /// The same; where nothing is known, one may be assumed. Throws DataError.
  [[nodiscard]] Rig load(const std::filesystem::path& sequence, const StreamArguments& streams,
                         Diagnostics* diagnostics = nullptr) const;
};

/// True once Ctrl-C was pressed or the program was told to terminate, after install_interrupt_handler().
bool interrupted();
void install_interrupt_handler();
constexpr int kExitInterrupted = 130;
/// Of a run in which no second was tracked: its results are there, and worthless.
constexpr int kExitNothingTracked = 3;
/// Thrown where a wait for something was interrupted, and nothing is there to be written.
struct Interrupted {};

/// Prints each kind of oddity once, with its count and the code under which docs/troubleshooting.md has more,
/// to standard error; those of `said` were printed before.
void print_warnings(const Diagnostics& diagnostics, const Diagnostics& said = {});

}  // namespace idol::cli
