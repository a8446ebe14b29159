#include <fmt/format.h>

#include <memory>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol::cli {
namespace {

struct SegmentArguments {
  std::filesystem::path sequence, out, rig;
  OptionArguments options;
  SpanArguments span;
};

// Without a calibration the sensor is as large as its largest pixel says; a first pass finds out.
UndistortMap find_undistortion(const SegmentArguments& arguments) {
  if (const auto camera = find_camera(arguments.sequence, arguments.rig); camera && camera->width > 0)
    return UndistortMap(*camera);
  ReaderOptions reading;
  reading.need_imu = false;
  const auto reader = open_reader(arguments.sequence, reading);
  int width = 1, height = 1;
  while (const auto packet = reader->next())
    for (const Event& e : packet->events) {
      width = std::max(width, e.x + 1);
      height = std::max(height, e.y + 1);
    }
  return UndistortMap(width, height);
}

void write_labels(TextWriter& writer, const EventWindow& window, const SegmentedWindow& segments) {
  fmt::memory_buffer text;
  for (std::size_t i = window.overlap; i < window.events.size(); ++i) {
    const Event& e = window.events[i];
    fmt::format_to(std::back_inserter(text), "{} {} {} {:d} {}\n", format_stamp(e.t), e.x, e.y, e.polarity,
                   segments.ids[i]);
  }
  writer.write({text.data(), text.size()});
}

int segment(const SegmentArguments& arguments) {
  const Options options = arguments.options.resolve();
  const UndistortMap undistort = find_undistortion(arguments);
  ReaderOptions reading;
  reading.width = undistort.width();
  reading.height = undistort.height();
  reading.from_s = arguments.span.from_s;
  reading.to_s = arguments.span.to_s;
  reading.need_imu = false;
  const auto reader = open_reader(arguments.sequence, reading);
  install_interrupt_handler();

  TextWriter writer(arguments.out);
  Windower windower(options.window);
  Segmenter segmenter(options.segment, undistort);
  const auto process = [&](const EventWindow& window) { write_labels(writer, window, segmenter.process(window)); };
  std::string failure;
  try {
    while (!interrupted()) {
      const auto packet = reader->next();
      if (!packet) break;
      windower.push(packet->events);
      while (const auto window = windower.pop()) process(*window);
    }
  } catch (const DataError& e) {
    failure = e.what();
  }
  if (const auto window = windower.flush()) process(*window);
  writer.close();
  print_warnings(reader->diagnostics());
  if (!failure.empty()) throw DataError(failure);
  return interrupted() ? kExitInterrupted : 0;
}

}  // namespace

void add_segment(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<SegmentArguments>();
  auto* command = app.add_subcommand("segment", "Cluster events into line segments; no IMU needed");
  command->add_option("SEQUENCE", arguments->sequence, "recording: a folder in the RPG layout, or a file of events")
      ->required();
  command->add_option("--out", arguments->out, "text file: t x y p segment_id, -1 for none")->required();
  command->add_option("--rig", arguments->rig, "camera calibration, to straighten lines (found in the folder if there)");
  arguments->options.declare(*command);
  arguments->span.declare(*command);
  command->callback([&action, arguments] { action = [arguments] { return segment(*arguments); }; });
}

}  // namespace idol::cli
