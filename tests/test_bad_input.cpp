// What users really bring: damaged, cut, mixed up and half-empty recordings, through the program's front
// door. Errors end with status 1 and one line, oddities are survived, said once and counted, and nothing
// crashes, hangs or passes for a success.
#include <fmt/format.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "compress_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;
using Lines = std::vector<std::string>;

std::string slurp(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string joined(const Lines& lines) {
  std::string text;
  for (const auto& line : lines) text += line + "\n";
  return text;
}

double stamp_of(const std::string& line) { return std::stod(line); }
std::string with_stamp(double t, const std::string& line) {
  return fmt::format("{:.9f}{}", t, line.substr(line.find(' ')));
}

/// A good recording in the RPG layout, as text to be damaged. Made once by `idol simulate`.
struct Recording {
  Lines events, imu;
  std::string rig, truth;

  static Recording make() {
    const TempDir dir;
    const auto result =
        run_idol(fmt::format("simulate '{}/scenes/shapes.yaml' --out '{}' --duration 2.3 --still 0.3 --plain "
                             "--background-hz 0.02 --hot-pixels 0 --amplitude 0.06 --rotation 0.05 "
                             "--drop-events 0.5 --imu-rate 500",
                             IDOL_DATA_DIR, dir.path().string()));
    if (result.status != 0) throw std::runtime_error(result.err);
    const auto lines = [&](const char* name) {
      std::ifstream in(dir.path() / name);
      Lines out;
      for (std::string line; std::getline(in, line);) out.push_back(line);
      return out;
    };
    return {lines("events.txt"), lines("imu.txt"), slurp(dir.path() / "camchain-imucam.yaml"),
            slurp(dir.path() / "groundtruth.txt")};
  }
  static const Recording& good() {
    static const Recording recording = make();
    return recording;
  }

  /// Without what comes after `to_s`: enough for a few windows, and quick.
  [[nodiscard]] Recording until(double to_s) const {
    Recording cut = *this;
    for (Lines* lines : {&cut.events, &cut.imu})
      std::erase_if(*lines, [&](const std::string& line) { return stamp_of(line) > to_s; });
    return cut;
  }
  void write(const TempDir& dir) const {
    dir.write("events.txt", joined(events));
    dir.write("imu.txt", joined(imu));
    dir.write("camchain-imucam.yaml", rig);
  }
};

/// A recording's folder and what `idol` makes of it.
class BadInput : public ::testing::Test {
 protected:
  CommandResult run(const std::string& extra = {}) const {
    return run_idol(fmt::format("run '{}' --out '{}' {}", dir_.path().string(), out().string(), extra));
  }
  CommandResult segment(const std::string& extra = {}) const {
    return run_idol(
        fmt::format("segment '{}' --out '{}' {}", dir_.path().string(), labels().string(), extra));
  }
  [[nodiscard]] fs::path out() const { return results_.path() / "out"; }
  [[nodiscard]] fs::path labels() const { return results_.path() / "labels.txt"; }
  [[nodiscard]] nlohmann::json stats() const { return nlohmann::json::parse(slurp(out() / "stats.json")); }
  [[nodiscard]] std::int64_t rows(const fs::path& path) const {
    const std::string text = slurp(path);
    return std::count(text.begin(), text.end(), '\n');
  }

  static void expect_error(const CommandResult& result, const Lines& parts, int status = 1) {
    EXPECT_EQ(result.status, status) << result.err;
    // What the checks before the run say, and one line more: the error.
    std::istringstream lines(result.err);
    std::string error;
    for (std::string line; std::getline(lines, line);) {
      EXPECT_TRUE(error.empty()) << result.err;
      EXPECT_TRUE(line.starts_with("idol: ")) << result.err;
      if (!line.starts_with("idol: warning: ") && !line.ends_with("before the reading's end")) error = line;
    }
    expect_says(error, parts);
  }
  /// Status 0, each kind said in one line and counted in stats.json, nothing else said.
  void expect_warnings(const CommandResult& result, const std::map<std::string, std::int64_t>& kinds,
                       const Lines& parts = {}) const {
    ASSERT_EQ(result.status, 0) << result.err;
    const std::int64_t said = std::count(result.err.begin(), result.err.end(), '\n');
    EXPECT_EQ(said, std::ssize(kinds)) << result.err;
    expect_says(result.err, parts);
    std::map<std::string, std::int64_t> counted;
    const auto all = stats();
    for (const auto& [kind, entry] : all["warnings"].items()) counted[kind] = entry["count"];
    EXPECT_EQ(counted, kinds);
    EXPECT_EQ(all["status"], "done");
  }
  /// A run that ended badly, but wrote what it could.
  void expect_partial_results() const {
    EXPECT_GT(rows(out() / "trajectory_camera.txt"), 2);
    EXPECT_TRUE(fs::exists(out() / "report.html"));
    const auto all = stats();
    EXPECT_NE(all["status"], "done");
    EXPECT_GT(all["windows"], 1);
  }
  /// The last position of a trajectory stays within what a hand can do.
  void expect_sane_trajectory(double until_s) const {
    std::ifstream in(out() / "trajectory_imu.txt");
    double t = 0, largest = 0;
    for (std::string line; std::getline(in, line);) {
      if (line.starts_with('#')) continue;
      double x = 0, y = 0, z = 0;
      ASSERT_EQ(std::sscanf(line.c_str(), "%lf %lf %lf %lf", &t, &x, &y, &z), 4) << line;
      largest = std::max(largest, std::sqrt(x * x + y * y + z * z));
    }
    EXPECT_GT(t, until_s);
    EXPECT_LT(largest, 0.5);
  }

  const TempDir dir_, results_;
};

TEST_F(BadInput, GoodInputSaysNothingAndIsJudged) {
  Recording::good().write(dir_);
  dir_.write("groundtruth.txt", Recording::good().truth);
  const auto result = run();
  expect_warnings(result, {});
  expect_says(result.out, {"protocol full: translation RMSE", "MPE", "rotation RMSE"});
  expect_sane_trajectory(2.2);
  const auto json = dir_.path() / "evaluate.json";
  const auto evaluated = run_idol(
      fmt::format("evaluate '{}' '{}' --json '{}'", out().string(), dir_.path().string(), json.string()));
  EXPECT_EQ(evaluated.status, 0) << evaluated.err;
  EXPECT_EQ(slurp(json), slurp(out() / "evaluation.json"));
  EXPECT_EQ(segment().status, 0);
  EXPECT_EQ(rows(labels()), std::ssize(Recording::good().events));
}

TEST_F(BadInput, MissingOrEmptyFiles) {
  expect_error(run_idol(fmt::format("run /absent/recording --out '{}'", out().string())),
               {"/absent/recording", "no such file or folder"});
  expect_error(run_idol(fmt::format("segment /absent/recording --out '{}'", labels().string())),
               {"/absent/recording"});
  const Recording short_one = Recording::good().until(0.2);
  short_one.write(dir_);
  expect_error(run("--rig /absent/rig.yaml"), {"/absent/rig.yaml"});
  dir_.write("events.txt", "");
  expect_error(run(), {"events.txt", "empty"});
  expect_error(segment(), {"events.txt", "empty"});
  fs::remove(dir_.path() / "events.txt");
  expect_error(run(), {dir_.path().string(), "no events.txt"});
  short_one.write(dir_);
  dir_.write("imu.txt", "");
  expect_error(run(), {"imu.txt", "empty"});
  fs::remove(dir_.path() / "imu.txt");
  expect_error(run(), {dir_.path().string(), "no imu.txt"});
  fs::remove(dir_.path() / "camchain-imucam.yaml");
  expect_error(run(), {dir_.path().string(), "camchain-imucam.yaml"});
  EXPECT_FALSE(fs::exists(out() / "trajectory_camera.txt"));
}

TEST_F(BadInput, BinaryGarbage) {
  Recording::good().until(0.2).write(dir_);
  std::mt19937 rng(7);
  std::string garbage(100000, '\0');
  for (char& c : garbage) c = static_cast<char>(rng());
  dir_.write("imu.txt", garbage);
  expect_error(run(), {"imu.txt:1"});
  dir_.write("events.txt", garbage);
  expect_error(run(), {"events.txt:1"});
  expect_error(segment(), {"events.txt:1"});
  dir_.write("camchain-imucam.yaml", garbage);
  expect_error(run(), {"camchain-imucam.yaml"});
}

TEST_F(BadInput, CutOffCompressionGivesWhatCameBefore) {
  const Recording recording = Recording::good().until(1.2);
  recording.write(dir_);
  fs::remove(dir_.path() / "events.txt");
  const std::string text = joined(recording.events);
  for (const auto& [name, bytes] :
       {std::pair("events.txt.gz", gzip(text)), std::pair("events.txt.zst", zstd(text))}) {
    dir_.write(name, bytes.substr(0, bytes.size() * 2 / 3));
    expect_error(run(), {name, "cut off", "again"});
    expect_partial_results();
    expect_error(segment(), {name, "cut off"});
    EXPECT_GT(rows(labels()), std::ssize(recording.events) / 4);
    fs::remove(dir_.path() / name);
  }
  // Without a calibration too, where a first pass looks for the sensor's size.
  fs::remove(dir_.path() / "camchain-imucam.yaml");
  const std::string bytes = gzip(text);
  dir_.write("events.txt.gz", bytes.substr(0, bytes.size() * 2 / 3));
  fs::remove(labels());
  expect_error(segment(), {"events.txt.gz", "cut off"});
  EXPECT_GT(rows(labels()), std::ssize(recording.events) / 4);
}

TEST_F(BadInput, WrongColumns) {
  Recording recording = Recording::good().until(1);
  recording.events.insert(recording.events.end() - 100, "0.9 1 2");
  recording.write(dir_);
  const std::string place = fmt::format("events.txt:{}", recording.events.size() - 100);
  expect_error(run(), {place, "3 columns where 4"});
  expect_partial_results();
  expect_error(segment(), {place, "3 columns where 4"});
  EXPECT_EQ(rows(labels()), std::ssize(recording.events) - 101);
  recording.imu[400] += " 5";
  recording.write(dir_);
  expect_error(run(), {"imu.txt:401", "8 columns where 7"});
}

TEST_F(BadInput, ManyUnusableRows) {
  for (const char* row : {"nan 3 4 1", "{} 999 4 1"}) {
    Recording recording = Recording::good().until(0.8);
    for (std::size_t i = 100; i < recording.events.size(); i += 300) {
      const std::string stamp = recording.events[i].substr(0, recording.events[i].find(' '));
      recording.events[i] = fmt::format(fmt::runtime(row), stamp);
    }
    recording.write(dir_);
    expect_error(run(), {"events.txt", "unusable", "events.txt:101"});
    expect_error(segment(), {"events.txt", "unusable", "events.txt:101"});
  }
}

TEST_F(BadInput, WrongResolution) {
  Recording recording = Recording::good().until(0.8);
  const auto at = recording.rig.find("[240, 180]");
  ASSERT_NE(at, std::string::npos) << recording.rig;
  recording.rig.replace(at, 10, "[160, 120]");
  recording.write(dir_);
  expect_error(run(), {"events.txt", "outside the sensor of 160 x 120", "rig"});
  expect_error(segment(), {"events.txt", "outside the sensor of 160 x 120"});
}

TEST_F(BadInput, StampsThatGoBackAgainAndAgain) {
  Recording recording = Recording::good().until(1);
  for (std::size_t i = recording.events.size() / 2; i < recording.events.size(); i += 50)
    recording.events[i] = with_stamp(stamp_of(recording.events[i]) - 0.01, recording.events[i]);
  recording.write(dir_);
  expect_error(run(), {"events.txt:", "again and again", "sort"});
  expect_partial_results();
  expect_error(segment(), {"events.txt:", "again and again"});
}

TEST_F(BadInput, AClockThatJumpsAheadDoesNotRunForever) {
  Recording recording = Recording::good().until(1);
  for (std::size_t i = recording.events.size() / 2; i < recording.events.size(); ++i)
    recording.events[i] = with_stamp(stamp_of(recording.events[i]) + 1.5e9, recording.events[i]);
  recording.write(dir_);
  expect_error(run(), {"events.txt:", "jump ahead"});
  expect_error(segment(), {"events.txt:", "jump ahead"});
}

TEST_F(BadInput, StreamsThatDoNotOverlap) {
  for (const double shift : {1000.0, -1000.0}) {
    Recording recording = Recording::good().until(0.8);
    for (auto& line : recording.imu) line = with_stamp(stamp_of(line) + shift, line);
    recording.write(dir_);
    expect_error(run(), {"events.txt", "imu.txt", "overlap"});
    EXPECT_FALSE(fs::exists(out() / "trajectory_camera.txt"));
  }
}

TEST_F(BadInput, RigWithoutExtrinsics) {
  Recording recording = Recording::good().until(0.2);
  // The block T_cam_imu: its key and its four rows.
  std::string kept;
  bool inside = false;
  std::istringstream lines(recording.rig);
  for (std::string line; std::getline(lines, line);) {
    const auto text = line.find_first_not_of(" -");
    inside = line.find("T_cam_imu") != std::string::npos ||
             (inside && text != std::string::npos && line[text] == '[');
    if (!inside) kept += line + "\n";
  }
  ASSERT_LT(kept.size(), recording.rig.size());
  recording.rig = kept;
  recording.write(dir_);
  expect_error(run(), {"camchain-imucam.yaml", "extrinsics"});
  EXPECT_EQ(segment().status, 0);
}

TEST_F(BadInput, OutputThatCannotBeWritten) {
  Recording::good().until(0.4).write(dir_);
  const std::string below = (results_.write("file", "") / "out").string();  // refused even to root
  expect_error(run_idol(fmt::format("run '{}' --out '{}'", dir_.path().string(), below)),
               {below, "cannot be"});
  expect_error(run_idol(fmt::format("segment '{}' --out '{}'", dir_.path().string(), below)),
               {below, "cannot be"});
  expect_error(run_idol(fmt::format("segment '{}' --out /dev/full", dir_.path().string())),
               {"/dev/full", "space"});
}

TEST_F(BadInput, FullDisk) {
  Recording::good().until(0.6).write(dir_);
  fs::create_directories(out());
  std::set<std::string> ends;
  for (const char* size : {"size=4k", "size=16k", "size=40k", "size=160k"}) {
    if (mount("tmpfs", out().c_str(), "tmpfs", 0, size) != 0)
      GTEST_SKIP() << "mounting a small tmpfs is not permitted";
    const auto result = run();
    umount(out().c_str());
    expect_error(result, {out().string(), "cannot be", "space"});
    ends.insert(result.err);
  }
  EXPECT_GT(ends.size(), 1U);  // the disk was full at different files
}

TEST_F(BadInput, IsolatedOddRowsAreSkipped) {
  Recording recording = Recording::good().until(1.3);
  auto& events = recording.events;
  ASSERT_GT(events.size(), 10000U);
  events[5000] = "nan 3 4 1";
  events[6000] = with_stamp(stamp_of(events[6000]), "0 999 4 1");
  for (const std::size_t i : {7000, 8000, 9000}) std::swap(events[i], events[i + 1]);
  // Two stamps may be the same in the file: then nothing is out of order.
  std::int64_t swapped = 0;
  for (const std::size_t i : {7000, 8000, 9000})
    swapped += stamp_of(events[i]) > stamp_of(events[i + 1]) ? 1 : 0;
  ASSERT_GT(swapped, 0);
  recording.imu[100] = "nan 0 0 9.81 0 0 0";
  recording.imu.insert(recording.imu.begin() + 200, recording.imu[200]);
  recording.imu[300] = with_stamp(stamp_of(recording.imu[300]), "0 0 1e30 9.81 0 0 0");
  recording.write(dir_);
  expect_warnings(
      run(),
      {{"nan_row", 3}, {"outside_pixel", 1}, {"out_of_order_event", swapped}, {"duplicate_imu_stamp", 1}},
      {"events.txt:5001", "events.txt:6001", "999"});
  const auto segmented = segment();
  EXPECT_EQ(segmented.status, 0);
  EXPECT_EQ(rows(labels()), std::ssize(events) - 2 - swapped);
}

TEST_F(BadInput, ImuGapIsBridgedAndTold) {
  Recording recording = Recording::good();
  std::erase_if(recording.imu,
                [](const std::string& line) { return stamp_of(line) > 1 && stamp_of(line) < 1.5; });
  recording.write(dir_);
  expect_warnings(run(), {{"imu_gap", 1}}, {"the longest of 0.5"});
  expect_sane_trajectory(2.2);
}

TEST_F(BadInput, ImuThatEndsEarlyOrBeginsLate) {
  Recording recording = Recording::good();
  std::erase_if(recording.imu, [](const std::string& line) { return stamp_of(line) > 1.2; });
  recording.write(dir_);
  const auto early = run();
  EXPECT_EQ(early.status, 0) << early.err;
  expect_says(early.err, {"IMU ends 1.1"});
  expect_sane_trajectory(1.15);
  EXPECT_TRUE(stats()["warnings"].contains("imu_ends_early"));

  recording = Recording::good();
  std::erase_if(recording.imu, [](const std::string& line) { return stamp_of(line) < 0.1; });
  recording.write(dir_);
  const auto late = run("--to 1");
  EXPECT_EQ(late.status, 0) << late.err;
  expect_says(late.err, {"IMU starts at 0.1"});
  EXPECT_TRUE(stats()["warnings"].contains("events_before_imu"));
}

// The camera stands still in the still start: events stop, the IMU goes on.
TEST_F(BadInput, SilenceOfTheCameraIsToldAndSurvived) {
  constexpr double kFrom = 0.2, kPause = 1.5;
  Recording recording = Recording::good();
  for (auto& line : recording.events)
    if (stamp_of(line) > kFrom) line = with_stamp(stamp_of(line) + kPause, line);
  Lines imu;
  for (const auto& line : recording.imu)
    if (stamp_of(line) <= kFrom) imu.push_back(line);
  const std::size_t before = imu.size();
  for (int i = 1; i < 750; ++i)
    imu.push_back(with_stamp(kFrom + 0.002 * i, imu[static_cast<std::size_t>(i) % before]));
  for (const auto& line : recording.imu)
    if (stamp_of(line) > kFrom) imu.push_back(with_stamp(stamp_of(line) + kPause, line));
  recording.imu = imu;
  recording.write(dir_);
  expect_warnings(run(), {{"no_events", 1}}, {"no event for 1.5", "from 0.1"});
  expect_sane_trajectory(2.2 + kPause);
  const auto segmented = segment();
  EXPECT_EQ(segmented.status, 0);
  expect_says(segmented.err, {"no event for 1.5"});
  EXPECT_EQ(rows(labels()), std::ssize(recording.events));
}

TEST_F(BadInput, HotPixelsAreTold) {
  Recording recording = Recording::good();
  for (int i = 0; i < 1100; ++i)
    for (const char* pixel : {" 100 50 1", " 31 151 0"})
      recording.events.push_back(fmt::format("{:.9f}{}", 0.002 * i, pixel));
  std::stable_sort(recording.events.begin(), recording.events.end(),
                   [](const std::string& a, const std::string& b) { return stamp_of(a) < stamp_of(b); });
  recording.write(dir_);
  expect_warnings(run(), {{"hot_pixels", 2}}, {"hot pixel (100, 50)", "(2 times)"});
}

TEST_F(BadInput, DamagedGroundTruthCostsOnlyTheComparison) {
  Recording::good().until(0.8).write(dir_);
  for (const auto& [truth, said] :
       {std::pair<std::string, std::string>{"0.1 0 0 0 0 0 0 1\n0.2 0 0 0\n", "groundtruth.txt"},
        {"5000 0 0 0 0 0 0 1\n", "ground truth: no estimate pose"},
        {"\x01\x02\xff\n", "groundtruth.txt"},
        {"", "groundtruth.txt"}}) {
    dir_.write("groundtruth.txt", truth);
    expect_warnings(run(), {{"bad_groundtruth", 1}, {"imu_still", 1}}, {said});
    EXPECT_FALSE(fs::exists(out() / "evaluation.json"));
    EXPECT_TRUE(fs::exists(out() / "report.html"));
  }
}

TEST_F(BadInput, FailedRunLeavesNoOldResults) {
  Recording recording = Recording::good().until(0.8);
  recording.write(dir_);
  ASSERT_EQ(run().status, 0);
  ASSERT_TRUE(fs::exists(out() / "trajectory_camera.txt"));
  for (auto& line : recording.imu) line = with_stamp(stamp_of(line) + 1000, line);
  recording.write(dir_);
  EXPECT_EQ(run().status, 1);
  EXPECT_FALSE(fs::exists(out() / "trajectory_camera.txt"));
  EXPECT_FALSE(fs::exists(out() / "report.html"));
}

TEST_F(BadInput, WrongUsage) {
  Recording::good().until(0.2).write(dir_);
  const std::string config = dir_.write("my.yaml", "window:\n  max_events: 5000\n  colour: 3\n").string();
  for (const bool whole : {true, false}) {
    const auto command = [&](const std::string& extra) { return whole ? run(extra) : segment(extra); };
    expect_error(command("--bogus 3"), {"--bogus"}, 2);
    expect_error(command("--set window.colour=3"), {"--set", "window.colour"}, 2);
    expect_error(command("--set window.max_events"), {"--set", "window.max_events"}, 2);
    expect_error(command("--set window.max_events=many"), {"--set", "window.max_events", "many"}, 2);
    expect_error(command("--preset fast"), {"fast"}, 2);
    expect_error(command("--config '" + config + "'"), {"my.yaml:3", "window.colour"}, 2);
    expect_error(command("--from 3 --to 2"), {"3", "2"}, 2);
  }
  expect_error(run_idol("run"), {"SEQUENCE"}, 2);
  expect_error(run_idol("fly"), {"subcommand"}, 2);
}

TEST_F(BadInput, SegmentIsNotFooledByOneWildPixel) {
  Recording recording = Recording::good().until(1);
  ASSERT_GT(recording.events.size(), 5000U);
  recording.events[4000] = with_stamp(stamp_of(recording.events[4000]), "0 60000 60000 1");
  recording.write(dir_);
  fs::remove(dir_.path() / "camchain-imucam.yaml");
  const auto result = segment();
  EXPECT_EQ(result.status, 0) << result.err;
  expect_says(result.err, {"events.txt:4001", "(60000, 60000)"});
  EXPECT_EQ(rows(labels()), std::ssize(recording.events) - 1);

  for (auto& line : recording.events) line = with_stamp(stamp_of(line), "0 50000 3 1");
  recording.write(dir_);
  fs::remove(dir_.path() / "camchain-imucam.yaml");
  expect_error(segment(), {dir_.path().string(), "50000", "columns"});
}

/// Starts `idol` and sends it a signal after `delay`; its exit status, or -1 if it did not end by itself.
int run_and_signal(const Lines& arguments, int signal, std::chrono::milliseconds delay) {
  const pid_t child = fork();
  if (child == 0) {
    std::vector<char*> argv;
    std::string program = IDOL_PROGRAM;
    argv.push_back(program.data());
    for (const auto& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    if (std::freopen("/dev/null", "w", stdout) == nullptr ||
        std::freopen("/dev/null", "w", stderr) == nullptr)
      _exit(99);
    execv(argv[0], argv.data());
    _exit(99);
  }
  std::this_thread::sleep_for(delay);
  kill(child, signal);
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST_F(BadInput, InterruptedRunWritesWhatItHas) {
  Recording::good().write(dir_);
  // Many small windows and the full batch: minutes of work.
  const Lines arguments = {"run",   dir_.path().string(),   "--out", out().string(), "--preset", "paper",
                           "--set", "window.max_events=300"};
  for (const int signal : {SIGINT, SIGTERM}) {
    // On a busy machine the first window may take its time.
    for (auto delay = std::chrono::milliseconds(700); delay < std::chrono::seconds(30); delay *= 2) {
      fs::remove_all(out());
      ASSERT_EQ(run_and_signal(arguments, signal, delay), 130);
      if (stats()["windows"] > 1) break;
    }
    expect_partial_results();
  }
}

}  // namespace
}  // namespace idol::test
