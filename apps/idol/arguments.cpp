#include "arguments.hpp"

#include <fmt/format.h>

#include <csignal>
#include <cstdio>

#include "idol/odometry/presets.hpp"

namespace idol::cli {
namespace {

volatile std::sig_atomic_t interrupt_count = 0;

void on_interrupt(int) {
  interrupt_count = interrupt_count + 1;
  // The second one ends the program at once.
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

}  // namespace

void OptionArguments::declare(CLI::App& command) {
  command
      .add_option("--preset", preset,
                  "set of options to start from: realtime, or paper (the method as published)")
      ->capture_default_str();
  command.add_option("--config", config, "YAML file of options ('idol config' prints one)");
  command.add_option("--set", set, "one option, group.name=value; may be repeated")
      ->allow_extra_args(false)
      ->expected(1, CLI::detail::expected_max_vector_size);
}

Options OptionArguments::resolve() const {
  Options options = idol::preset(preset);
  std::vector<OptionField> fields;
  list_fields(options, fields);
  if (!config.empty()) load_options(fields, config);
  for (const auto& assignment : set) {
    const auto equals = assignment.find('=');
    if (equals == std::string::npos)
      throw UsageError(fmt::format("--set {}: expected group.name=value", assignment));
    set_option(fields, assignment.substr(0, equals), assignment.substr(equals + 1), "--set");
  }
  return options;
}

void SpanArguments::declare(CLI::App& command) {
  command.add_option("--from", from_s, "start, seconds from the recording's first stamp")
      ->check(CLI::NonNegativeNumber);
  command.add_option("--to", to_s, "end, seconds from the recording's first stamp")
      ->check(CLI::NonNegativeNumber);
}

void StreamArguments::declare(CLI::App& command) {
  constexpr const char* kGroup = "Streams (topics of a bag, streams of AEDAT 4, groups of HDF5)";
  const auto add = [&](const char* option, std::string& name, const char* what) {
    command.add_option(option, name, what)->group(kGroup)->type_name("NAME");
  };
  add("--events-topic", choice.events, "the events, where there are several");
  add("--imu-topic", choice.imu, "the IMU, where there are several; ACCEL,GYRO: two topics of a bag");
  add("--truth-topic", choice.truth, "the ground truth, where there are several");
  command
      .add_option("--camera", choice.camera,
                  "of a rig file with several: cam1, or 1 (default: by the sensor's size)")
      ->group(kGroup)
      ->type_name("NAME");
  command.add_option("--imu", choice.imu_file, "take the IMU from this file or recording instead")
      ->group(kGroup)
      ->type_name("PATH");
}

void RigArguments::declare(CLI::App& command) {
  command.add_option(
      "--rig", rig,
      "calibration of camera and mounting: a file (Kalibr camchain, OpenVINS, Basalt) or the name of a "
      "ready rig (davis240c, davis346, dvxplorer, evk4)");
  command.add_option("--imu-rig", imu_rig, "IMU noise (Kalibr imu.yaml)");
}

Rig RigArguments::load(const std::filesystem::path& sequence, const StreamArguments& streams,
                       Diagnostics* diagnostics) const {
  return load_rig(sequence, rig, imu_rig, diagnostics, stated_size(sequence, streams.choice),
                  camera_choice(sequence, streams.choice));
}

bool interrupted() { return interrupt_count > 0; }
void install_interrupt_handler() {
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
}

void print_warnings(const Diagnostics& diagnostics, const Diagnostics& said) {
  for (const auto& [kind, entry] : diagnostics.entries())
    if (!said.entries().contains(kind))
      fmt::print(stderr, "idol: warning: {}{} [{}]\n", entry.first_message,
                 entry.count > 1 ? fmt::format(" ({} times)", entry.count) : "", kind);
}

}  // namespace idol::cli
