// Events a second through the reader: text, plain and compressed, beside what the standard library would do,
// and the binary formats.
#include <benchmark/benchmark.h>
#include <fmt/format.h>
#include <unistd.h>

#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "idol/io/reader.hpp"
#include "idol/io/recording_writer.hpp"
#include "idol/io/rows.hpp"

namespace {

constexpr int kLines = 1'000'000;

/// A recording like those of a DAVIS240C: a microsecond or so between events.
const std::string& recording() {
  static const std::string text = [] {
    std::mt19937 rng(1);
    std::string lines;
    std::int64_t us = 2'097'134;
    for (int i = 0; i < kLines; ++i) {
      us += static_cast<std::int64_t>(rng() % 3);
      lines += fmt::format("{}.{:06}000 {} {} {}\n", us / 1'000'000, us % 1'000'000, rng() % 240, rng() % 180,
                           rng() % 2);
    }
    return lines;
  }();
  return text;
}

/// The recording on disk, gone at the end of the program.
class File {
 public:
  explicit File(const char* compressor) {
    path_ = std::filesystem::temp_directory_path() / fmt::format("idol_bench_{}_{}", getpid(), compressor);
    std::ofstream(path_, std::ios::binary) << recording();
    if (*compressor == '\0') return;
    const std::string packed = path_.string() + ".packed";
    works_ = std::system(fmt::format("{} -c '{}' > '{}'", compressor, path_.string(), packed).c_str()) == 0;
    std::filesystem::rename(packed, path_);
  }
  ~File() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] bool works() const { return works_; }

 private:
  std::filesystem::path path_;
  bool works_ = true;
};

void count_lines(benchmark::State& state) {
  state.SetItemsProcessed(state.iterations() * kLines);
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(recording().size()));
}

void read_all(benchmark::State& state, const std::filesystem::path& path) {
  idol::ReaderOptions options;
  options.width = 240;
  options.height = 180;
  options.need_imu = false;
  for (auto _ : state) {
    const auto open = idol::open_reader(path, options);
    std::size_t events = 0;
    while (const auto packet = open->next()) events += packet->events.size();
    if (events != kLines) return state.SkipWithError("events are missing");
  }
}

void reader(benchmark::State& state, const char* compressor) {
  const File file(compressor);
  if (!file.works()) return state.SkipWithError("compressor not installed");
  read_all(state, file.path());
  count_lines(state);
}
BENCHMARK_CAPTURE(reader, plain, "")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(reader, zstd, "zstd -q")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(reader, gzip, "gzip")->Unit(benchmark::kMillisecond);

/// The same recording in a binary format, read again and again: warm.
void binary_reader(benchmark::State& state, const char* ending, bool compress) {
  const File text("");
  const std::filesystem::path path = text.path().string() + ending;
  {
    idol::ReaderOptions options;
    options.need_imu = false;
    const auto open = idol::open_reader(text.path(), options);
    const auto writer = idol::create_recording(path, idol::format_of_name(path), {240, 180, compress});
    while (const auto packet = open->next()) writer->add(*packet);
    writer->close();
  }
  read_all(state, path);
  std::filesystem::remove(path);
  state.SetItemsProcessed(state.iterations() * kLines);
}
BENCHMARK_CAPTURE(binary_reader, bag, ".bag", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(binary_reader, bag_lz4, ".bag", true)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(binary_reader, aedat4_lz4, ".aedat4", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(binary_reader, aedat4_zstd, ".aedat4", true)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(binary_reader, hdf5, ".h5", false)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(binary_reader, hdf5_zlib, ".h5", true)->Unit(benchmark::kMillisecond);

/// Calls `parse(line_begin, line_end)` for each line of the text in memory.
template <class Parse>
void each_line(benchmark::State& state, Parse parse) {
  for (auto _ : state) {
    const char* p = recording().data();
    const char* end = p + recording().size();
    while (p != end) {
      const char* stop = static_cast<const char*>(std::memchr(p, '\n', static_cast<std::size_t>(end - p)));
      parse(p, stop);
      p = stop + 1;
    }
  }
  count_lines(state);
}

void rows_in_memory(benchmark::State& state) {
  const idol::EventParser parser;
  idol::Event event;
  each_line(state, [&](const char* p, const char* end) {
    benchmark::DoNotOptimize(parser.parse({p, static_cast<std::size_t>(end - p)}, event));
    benchmark::DoNotOptimize(event);
  });
}
BENCHMARK(rows_in_memory)->Unit(benchmark::kMillisecond);

// The stamp as a double: from_chars knows no exact decimal.
void baseline_from_chars(benchmark::State& state) {
  each_line(state, [](const char* p, const char* end) {
    double t = 0;
    int x = 0;
    int y = 0;
    int polarity = 0;
    p = std::from_chars(p, end, t).ptr + 1;
    p = std::from_chars(p, end, x).ptr + 1;
    p = std::from_chars(p, end, y).ptr + 1;
    std::from_chars(p, end, polarity);
    benchmark::DoNotOptimize(t + x + y + polarity);
  });
}
BENCHMARK(baseline_from_chars)->Unit(benchmark::kMillisecond);

void baseline_strtod(benchmark::State& state) {
  each_line(state, [](const char* p, const char*) {
    char* next = nullptr;
    const double t = std::strtod(p, &next);
    const long x = std::strtol(next, &next, 10);
    const long y = std::strtol(next, &next, 10);
    const long polarity = std::strtol(next, &next, 10);
    benchmark::DoNotOptimize(t + static_cast<double>(x + y + polarity));
  });
}
BENCHMARK(baseline_strtod)->Unit(benchmark::kMillisecond);

void baseline_ifstream(benchmark::State& state) {
  const File file("");
  for (auto _ : state) {
    std::ifstream in(file.path());
    double t = 0;
    int x = 0;
    int y = 0;
    int polarity = 0;
    while (in >> t >> x >> y >> polarity) benchmark::DoNotOptimize(t + x + y + polarity);
  }
  count_lines(state);
}
BENCHMARK(baseline_ifstream)->Unit(benchmark::kMillisecond);

}  // namespace
