// Events per second of the front-end on one core, stage by stage, beside the paper's way, in one run.
// Recording: the bundled one, or the folders named in IDOL_BENCH_SEQUENCES (parted by ':'); of each at most
// kMostEvents from kFrom on.
#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <cstdlib>
#include <memory>
#include <sstream>

#include "idol/base/rig.hpp"
#include "idol/io/reader.hpp"
#include "idol/odometry/presets.hpp"
#include "reference_frontend.hpp"

namespace idol::bench {
namespace {

constexpr double kFrom = 2;  // [s]: in motion
constexpr std::size_t kMostEvents = 2'000'000;

struct Recording {
  std::string name;
  Camera camera;
  UndistortMap undistort;
  std::vector<EventWindow> windows;
  std::size_t events = 0;  // without the repeated ones
};

std::shared_ptr<Recording> load(const std::filesystem::path& folder) {
  const auto camera = find_camera(folder);
  if (!camera) throw DataError(folder.string() + ": no calibration");
  ReaderOptions reading;
  reading.need_imu = false;
  reading.from_s = kFrom;
  auto out = std::make_shared<Recording>(
      Recording{folder.filename().string(), *camera, UndistortMap(*camera), {}, 0});
  Windower windower(preset("realtime").window);
  const auto reader = open_reader(folder, reading);
  while (const auto packet = reader->next()) {
    windower.push(packet->events);
    while (auto window = windower.pop()) {
      out->events += window->events.size() - window->overlap;
      out->windows.push_back(std::move(*window));
    }
    if (out->events >= kMostEvents) break;
  }
  return out;
}

void count(benchmark::State& state, const Recording& recording) {
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(recording.events));
}

void reference(benchmark::State& state, const Recording& recording) {
  ReferenceFrontend frontend(recording.undistort, 0.01F);
  for (auto _ : state)
    for (const auto& window : recording.windows) benchmark::DoNotOptimize(frontend.process(window));
  count(state, recording);
}

void segmenter(benchmark::State& state, const Recording& recording, const SegmentOptions& options) {
  for (auto _ : state) {
    const auto frontend = make_segmenter(options, recording.undistort);
    for (const auto& window : recording.windows) benchmark::DoNotOptimize(frontend->process(window));
  }
  count(state, recording);
}

// Claims and detection alone: no lists of segments, no fits.
void tracker(benchmark::State& state, const Recording& recording) {
  const TrackOptions options;
  std::vector<LineId> labels;
  for (auto _ : state) {
    LineTracker frontend(options, recording.undistort);
    for (const auto& window : recording.windows) {
      labels.assign(window.events.size(), kNoLine);
      for (std::size_t i = window.overlap; i < window.events.size();) {
        const auto n = frontend.batch_length(std::span(window.events).subspan(i), window.begin);
        frontend.process({&window.events[i], n}, &labels[i]);
        i += n;
      }
    }
    benchmark::DoNotOptimize(labels.data());
  }
  count(state, recording);
}

void declare(const std::shared_ptr<Recording>& recording) {
  const auto add = [&](const std::string& stage, auto function) {
    benchmark::RegisterBenchmark((stage + "/" + recording->name).c_str(), [=](benchmark::State& state) {
      function(state, *recording);
    })->Unit(benchmark::kMillisecond);
  };
  SegmentOptions track, paper = preset("paper").segment;
  track.method = SegmentMethod::kTrack;
  add("reference", reference);
  add("paper", [=](auto& state, const auto& r) { segmenter(state, r, paper); });
  add("track_claims", tracker);
  add("track_all", [=](auto& state, const auto& r) { segmenter(state, r, track); });
}

}  // namespace
}  // namespace idol::bench

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  const char* named = std::getenv("IDOL_BENCH_SEQUENCES");
  std::istringstream folders(named ? named : IDOL_DATA_DIR "/shapes_demo");
  try {
    for (std::string folder; std::getline(folders, folder, ':');)
      idol::bench::declare(idol::bench::load(folder));
  } catch (const std::exception& e) {
    fmt::print(stderr, "bench_frontend: {}\n", e.what());
    return 1;
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
