#include <fmt/format.h>

#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/base/rig.hpp"
#include "idol/frontend/segments.hpp"
#include "idol/frontend/windower.hpp"
#include "idol/image/flicker_filter.hpp"
#include "idol/image/tracker/delayed_labels.hpp"
#include "idol/io/event_monitor.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/sensor_size.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/picture.hpp"
#include "idol/report/picture_events.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

struct SegmentArguments {
  std::filesystem::path sequence, out, rig, pictures;
  bool no_imu = false;
  OptionArguments options;
  SpanArguments span;
  StreamArguments streams;
};

ReaderOptions reader_options(const SegmentArguments& arguments) {
  ReaderOptions reading;
  reading.from_s = arguments.span.from_s;
  reading.to_s = arguments.span.to_s;
  reading.need_imu = false;
  reading.choice = arguments.streams.choice;
  return reading;
}

// Without a calibration the sensor is as large as its events say; a first pass over the span finds out.
UndistortMap measure_sensor(const SegmentArguments& arguments) {
  const auto reader = open_reader(arguments.sequence, reader_options(arguments));
  SizeSeen seen;
  try {
    while (!interrupted()) {
      const auto packet = reader->next();
      if (!packet) break;
      seen.add(packet->events);
    }
  } catch (const DataError&) {
    // The second pass will meet it again, and tell.
    if (seen.empty()) throw;
  }
  const auto [width, height] = seen.size(arguments.sequence.string());
  return {width, height};
}

void write_label(fmt::memory_buffer& text, const Event& e, LineId id) {
  fmt::format_to(std::back_inserter(text), "{} {} {} {:d} {}\n", format_stamp(e.t), e.x, e.y, e.polarity, id);
}

// Writes and drops those of `left_out`, which are events of flicker in time order, that lie before `t`.
void write_left_out(fmt::memory_buffer& text, std::deque<Event>& left_out, Time t) {
  for (; !left_out.empty() && left_out.front().t < t; left_out.pop_front())
    write_label(text, left_out.front(), kNoLine);
}

void write_labels(TextWriter& writer, const EventWindow& window, const SegmentedWindow& segments,
                  std::deque<Event>& left_out) {
  fmt::memory_buffer text;
  for (std::size_t i = window.overlap; i < window.events.size(); ++i) {
    write_left_out(text, left_out, window.events[i].t);
    write_label(text, window.events[i], segments.ids[i]);
  }
  write_left_out(text, left_out, window.end);
  writer.write({text.data(), text.size()});
}

// Pictures of some windows: events around the middle, and the segments there.
class Pictures {
 public:
  Pictures(std::filesystem::path folder, const UndistortMap& undistort)
      : folder_(std::move(folder)), undistort_(undistort) {
    if (!folder_.empty()) claim_and_clear_pictures(folder_);
  }

  void add(const EventWindow& window, const SegmentedWindow& segments) {
    constexpr double kEvery = 0.1;  // [s]
    constexpr int kMost = 200, kScale = 3;
    if (folder_.empty() || count_ == kMost || window.begin < next_) return;
    next_ = window.begin + from_seconds(kEvery);
    const Time at = (window.begin + window.end) / 2;
    const double middle = seconds_between(window.begin, at);
    const auto events = picture_events(window, segments, undistort_, at);
    std::vector<PictureLine> lines;
    for (const Segment& s : segments.segments)
      if (s.straight)
        lines.push_back({s.line.point(s.line.u_min, middle), s.line.point(s.line.u_max, middle), s.id});
    write_png(folder_ / fmt::format("segments_{:03}_{}.png", count_++, format_stamp(window.begin)),
              draw_event_picture(undistort_.width(), undistort_.height(), events, lines, kScale));
  }

 private:
  std::filesystem::path folder_;
  const UndistortMap& undistort_;
  Time next_ = std::numeric_limits<Time>::min();
  int count_ = 0;
};

// The camera's turns by the gyro, where there is one and the rig says how it is mounted.
class Turns {
 public:
  explicit Turns(const std::optional<Rig>& rig) : rig_(rig) {}

  void add(std::span<const ImuSample> samples) {
    if (!rig_) return;
    for (CameraRate rate : camera_rates(samples, *rig_)) {
      rate.t -= from_seconds(rig_->time_offset_s);
      rates_.push_back(rate);
    }
  }
  /// Of the window; forgets what lies before it.
  std::span<const CameraRate> over(const EventWindow& window) {
    std::erase_if(rates_, [&](const CameraRate& rate) { return rate.t < window.begin; });
    return rates_over(rates_, window);
  }

 private:
  std::optional<Rig> rig_;
  std::vector<CameraRate> rates_;
};

std::optional<Rig> rig_of(const SegmentArguments& arguments) {
  if (arguments.no_imu) return std::nullopt;
  try {
    return load_rig(arguments.sequence, arguments.rig, {}, nullptr, {},
                    camera_choice(arguments.sequence, arguments.streams.choice));
  } catch (const std::runtime_error&) {  // lines follow the turns later, by their events
    return std::nullopt;
  }
}

// What is read is never written, and pictures come into a folder of their own.
void check_outputs(const SegmentArguments& arguments) {
  InputPaths inputs;
  inputs.add_recording(arguments.sequence, arguments.streams.choice, arguments.rig);
  inputs.add(arguments.options.config);
  for (const auto& output : {arguments.out, arguments.pictures})
    if (!output.empty()) inputs.refuse_output(output);
}

// Segments all that can be read; returns the reason if that is not all. A file that was there before is
// replaced only by a whole one.
std::string label_events(const SegmentArguments& arguments, const Options& options, Reader& reader,
                         const UndistortMap& undistort, const std::optional<Rig>& rig, bool replaces,
                         EventMonitor& monitor) {
  TextWriter writer(arguments.out);
  Windower windower(options.window);
  const auto segmenter = make_segmenter(options.segment, undistort);
  Pictures pictures(arguments.pictures, undistort);
  Turns turns(rig);
  FlickerFilter flicker_filter(undistort.width(), undistort.height());
  std::deque<Event> left_out;
  const auto take = [&](const Event& event, bool is_flicker) {
    if (is_flicker) {
      windower.leave_out_flicker(event.t);
      left_out.push_back(event);
    } else {
      windower.push({&event, 1});
    }
  };
  DelayedLabels delayed;
  const auto write = [&](const LabelledWindow& labelled) {
    write_labels(writer, labelled.window, labelled.segments, left_out);
    pictures.add(labelled.window, labelled.segments);
  };
  const auto process = [&](EventWindow&& window) {
    SegmentedWindow segments = segmenter->process(window, turns.over(window));
    delayed.add(std::move(window), std::move(segments));
    while (const auto labelled = delayed.pop()) write(*labelled);
  };
  std::string failure;
  try {
    while (!interrupted()) {
      const auto packet = reader.next();
      if (!packet) break;
      monitor.add(packet->events);
      turns.add(packet->imu);
      for (const Event& event : packet->events) {
        if (options.filter.flicker)
          flicker_filter.push(event, take);
        else
          windower.push({&event, 1});
      }
      while (auto window = interrupted() ? std::nullopt : windower.pop()) process(std::move(*window));
    }
  } catch (const DataError& e) {
    failure = e.what();
  }
  flicker_filter.finish(take);
  while (auto window = interrupted() ? std::nullopt : windower.pop()) process(std::move(*window));
  if (auto window = interrupted() ? std::nullopt : windower.flush()) process(std::move(*window));
  while (const auto labelled = delayed.flush()) write(*labelled);
  fmt::memory_buffer rest;  // behind the last event that is of use
  write_left_out(rest, left_out, std::numeric_limits<Time>::max());
  writer.write({rest.data(), rest.size()});
  if (!replaces || (failure.empty() && !interrupted())) writer.close();
  return failure;
}

int segment(SegmentArguments arguments) {
  arguments.sequence = input_path(arguments.sequence);
  const Options options = arguments.options.resolve();
  install_interrupt_handler();
  check_exists(arguments.sequence);
  check_outputs(arguments);
  const bool replaces = std::filesystem::is_regular_file(arguments.out);
  Diagnostics diagnostics;
  const auto camera = find_camera(arguments.sequence, arguments.rig, &diagnostics,
                                  camera_choice(arguments.sequence, arguments.streams.choice));
  const bool calibrated = camera && camera->width > 0;
  const UndistortMap undistort = calibrated ? UndistortMap(*camera) : measure_sensor(arguments);
  ReaderOptions reading = reader_options(arguments);
  reading.width = undistort.width();
  reading.height = undistort.height();
  const std::optional<Rig> rig = rig_of(arguments);
  reading.imu_if_present = rig.has_value();
  if (rig) reading.imu_offset_s = rig->time_offset_s;
  const auto reader = open_reader(arguments.sequence, reading);
  EventMonitor monitor(undistort.width(), undistort.height());
  const std::string failure = label_events(arguments, options, *reader, undistort, rig, replaces, monitor);
  if (!failure.empty() && replaces)
    fmt::print(stderr, "idol: {} is as it was; another --out gets what comes before the reading's end\n",
               arguments.out.string());
  if (!failure.empty()) throw DataError(failure);
  diagnostics.merge(reader->diagnostics());
  monitor.report(arguments.sequence.string(), diagnostics);
  if (calibrated && !interrupted())
    check_sensor_fit(arguments.sequence.string(), monitor, *camera, diagnostics);
  print_warnings(diagnostics);
  if (!interrupted()) return 0;
  fmt::print(stderr, "idol: interrupted: {} {}\n", arguments.out.string(),
             replaces ? "is as it was" : "holds the results so far");
  return kExitInterrupted;
}

}  // namespace

void add_segment(CLI::App& app, Action& action) {
  auto arguments = std::make_shared<SegmentArguments>();
  auto* command =
      app.add_subcommand("segment", "Cluster events into line segments; an IMU helps, but is not needed");
  command
      ->add_option("SEQUENCE", arguments->sequence, "recording: a folder or file of any format that is read")
      ->required();
  command->add_option("--out", arguments->out, "text file: t x y p segment_id, -1 for none")->required();
  command->add_option("--rig", arguments->rig,
                      "camera calibration, to straighten lines (found in the folder if there)");
  command->add_flag("--no-imu", arguments->no_imu, "do not follow the camera's turns by the gyro");
  command->add_option("--pictures", arguments->pictures, "folder for pictures of the segments, ten a second");
  arguments->options.declare(*command);
  arguments->span.declare(*command);
  arguments->streams.declare(*command);
  command->footer("Examples:\n  idol segment recording.bag --out segments.txt --pictures pictures --to 2");
  command->callback([&action, arguments] { action = [arguments] { return segment(*arguments); }; });
}

}  // namespace idol::cli
