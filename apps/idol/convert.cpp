#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/jobs/convert_recording.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

struct ConvertArguments {
  ConvertRequest request;
  RigArguments rig;
  std::string format;
  SpanArguments span;
  StreamArguments streams;
};

int convert(const ConvertArguments& arguments) {
  install_interrupt_handler();
  ConvertRequest request = arguments.request;
  request.in = input_path(request.in);
  request.format = parse_recording_format(arguments.format);
  request.rig_path = arguments.rig.rig;
  request.imu_rig_path = arguments.rig.imu_rig;
  request.from_s = arguments.span.from_s;
  request.to_s = arguments.span.to_s;
  request.choice = arguments.streams.choice;
  const Conversion done = convert_recording(request, interrupted);
  if (done.kept_old)
    fmt::print(stderr, "idol: {} is as it was; another OUT gets what comes before the reading's end\n",
               request.out.string());
  else
    fmt::print("{} events, {} IMU samples, {} poses written to {}\n", done.events, done.imu, done.poses,
               request.out.string());
  std::fflush(stdout);
  if (!done.damage.empty()) throw DataError(done.damage);
  print_warnings(done.diagnostics);
  return interrupted() ? kExitInterrupted : 0;
}

}  // namespace

void add_convert(CLI::App& app, Action& action) {
  auto a = std::make_shared<ConvertArguments>();
  auto* command = app.add_subcommand("convert", "Write a recording in another format");
  command->add_option("IN", a->request.in, "recording: a folder or file of any format that is read")
      ->required();
  command->add_option("OUT", a->request.out, "by its ending .bag, .h5, .aedat4; else a folder of text files")
      ->required();
  command->add_option("--format", a->format, "of OUT, whatever it is called")
      ->check(CLI::IsMember({"text", "bag", "hdf5", "aedat4"}));
  command->add_flag("--compress", a->request.compress, "smaller, and slower to read");
  a->rig.declare(*command);
  a->span.declare(*command);
  a->streams.declare(*command);
  command->footer(
      "Examples:\n"
      "  idol convert recording.aedat4 recording.bag\n"
      "  idol convert recording.bag folder --from 5 --to 20 --compress\n"
      "  idol convert events.h5 all.h5 --imu imu.bag --imu-topic /imu/data");
  command->callback([&action, a] { action = [a] { return convert(*a); }; });
}

}  // namespace idol::cli
