#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>

#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

const std::string kDemo = std::string(IDOL_DATA_DIR) + "/shapes_demo";

/// Runs a script for Debian's Python; its exit status and output.
CommandResult python(const TempDir& dir, const std::string& script, const std::string& arguments) {
  const fs::path file = dir.write("script.py", script), out = dir.path() / "python.out";
  const int status = std::system(
      fmt::format("/usr/bin/python3 '{}' {} >'{}' 2>&1", file.string(), arguments, out.string()).c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, slurp(out), {}};
}

bool python_has(const TempDir& dir, const std::string& module) {
  return python(dir, "import " + module, "").status == 0;
}

// AEDAT 4 holds the least: microseconds and readings of 24 bits. What it holds, all of them hold.
TEST(Convert, SameTrajectoryThroughEveryFormat) {
  const TempDir dir;
  const std::string in = (dir.path() / "first.aedat4").string();
  const auto first = run_idol("convert " + kDemo + " " + in + " --from 2 --to 3.5");
  ASSERT_EQ(first.status, 0) << first.err;
  std::map<std::string, std::string> results;
  for (const std::string name : {"text", "r.bag", "r.h5", "second.aedat4", "packed.h5"}) {
    const std::string path = (dir.path() / name).string(), out = (dir.path() / ("out_" + name)).string();
    const auto converted =
        run_idol("convert " + in + " " + path + (name == "packed.h5" ? " --compress" : ""));
    ASSERT_EQ(converted.status, 0) << converted.err;
    const auto run = run_idol("run " + path + " --out " + out + " --rig " + kDemo + "/camchain-imucam.yaml");
    ASSERT_EQ(run.status, 0) << run.err;
    results[name] = slurp(fs::path(out) / "states.csv") +
                    slurp(fs::path(out) / "trajectory_camera_causal.txt") +
                    slurp(fs::path(out) / "lines.csv");
    EXPECT_GT(results[name].size(), 5000u);
    EXPECT_TRUE(results[name] == results["text"]) << name;
  }
}

TEST(Convert, TextKeepsEverything) {
  const TempDir dir;
  const std::string bag = (dir.path() / "r.bag").string(), text = (dir.path() / "text").string();
  ASSERT_EQ(run_idol("convert " + kDemo + " " + bag + " --to 0.5").status, 0);
  const auto back = run_idol("convert " + bag + " " + text + " --rig " + kDemo + "/camchain-imucam.yaml");
  ASSERT_EQ(back.status, 0) << back.err;
  const ReadBack r = read_back(text), b = read_back(bag);
  Packet written;
  written.events = b.events;
  written.imu = b.imu;
  expect_same(r, written);
  EXPECT_GT(b.events.size(), 1000u);
  EXPECT_TRUE(fs::exists(fs::path(text) / "groundtruth.txt"));
  EXPECT_TRUE(fs::exists(fs::path(text) / "camchain-imucam.yaml"));
  EXPECT_EQ(run_idol("evaluate " + text + "/groundtruth.txt " + bag + " --protocol full").status, 0);
}

TEST(Convert, WrongUsage) {
  const TempDir dir;
  const fs::path bag = dir.path() / "r.bag";
  write(bag, {some_packet()}, false);
  EXPECT_EQ(run_idol("convert " + bag.string() + " " + bag.string()).status, 2);
  EXPECT_EQ(run_idol("convert " + bag.string() + " " + (dir.path() / "no/such/r.h5").string()).status, 1);
  EXPECT_EQ(run_idol("convert " + (dir.path() / "absent").string() + " x.bag").status, 1);
  EXPECT_EQ(read_back(bag).events.size(), 5000u);
}

TEST(Convert, BagIsReadByRosbag) {
  const TempDir dir;
  if (!python_has(dir, "rosbag")) GTEST_SKIP() << "python3-rosbag is not installed";
  const Packet packet = some_packet();
  for (const bool compress : {false, true}) {
    const fs::path bag = dir.path() / "r.bag";
    write(bag, {packet}, compress, some_truth());
    const auto result = python(dir, R"(
import rosbag, sys
bag = rosbag.Bag(sys.argv[1])
events = [e for _, m, _ in bag.read_messages('/dvs/events') for e in m.events]
imu = [m for _, m, _ in bag.read_messages('/dvs/imu')]
poses = [m for _, m, _ in bag.read_messages('/optitrack/davis')]
print(len(events), events[7].x, events[7].y, events[7].ts.to_nsec(), int(events[7].polarity))
print(len(imu), imu[3].header.stamp.to_nsec(), repr(imu[3].linear_acceleration.z), repr(imu[3].angular_velocity.x))
print(len(poses), repr(poses[2].pose.position.y))
)",
                               bag.string());
    const Event& e = packet.events[7];
    const ImuSample& s = packet.imu[3];
    EXPECT_EQ(result.out, fmt::format("{} {} {} {} {}\n{} {} {} {}\n{} {}\n", packet.events.size(), e.x, e.y,
                                      e.t, e.polarity ? 1 : 0, packet.imu.size(), s.t, s.accel.z(),
                                      s.gyro.x(), some_truth().size(), some_truth()[2].T.p.y()));
  }
}

TEST(Convert, Hdf5IsReadByH5py) {
  const TempDir dir;
  if (!python_has(dir, "h5py")) GTEST_SKIP() << "python3-h5py is not installed";
  const Packet packet = some_packet();
  const fs::path file = dir.path() / "r.h5";
  for (const bool compress : {false, true}) {
    write(file, {packet}, compress, some_truth());
    const auto result = python(dir, R"(
import h5py, sys
f = h5py.File(sys.argv[1])
e = f['events']
print(len(e['t']), e['t'][7], e['x'][7], e['y'][7], e['p'][7], f.attrs['width'])
print(f['imu/t'][3], repr(float(f['imu/accel'][3, 2])), f['groundtruth/orientation'].shape)
)",
                               file.string());
    const Event& e = packet.events[7];
    EXPECT_EQ(result.out,
              fmt::format("{} {} {} {} {} 240\n{} {} ({}, 4)\n", packet.events.size(), e.t, e.x, e.y,
                          e.polarity ? 1 : 0, packet.imu[3].t, packet.imu[3].accel.z(), some_truth().size()));
  }
}

// And files that h5py wrote, with its own compression and its booleans.
TEST(Convert, H5pyFilesAreRead) {
  const TempDir dir;
  if (!python_has(dir, "h5py")) GTEST_SKIP() << "python3-h5py is not installed";
  const fs::path file = dir.path() / "x_data.h5";
  const auto made = python(dir, R"(
import h5py, numpy, sys
f = h5py.File(sys.argv[1], 'w')
n = 1000
for name, values in dict(t=numpy.arange(n) * 10, x=numpy.arange(n) % 240, y=numpy.arange(n) % 180,
                         p=numpy.arange(n) % 2 == 0).items():
    f.create_dataset('prophesee/left/' + name, data=values, compression='lzf')
)",
                           file.string());
  ASSERT_EQ(made.status, 0) << made.out;
  const ReadBack r = read_back(file);
  EXPECT_EQ(r.error, "");
  ASSERT_EQ(r.events.size(), 1000u);
  EXPECT_EQ(r.events[241], (Event{2'410'000, 1, 61, false}));
}

}  // namespace
}  // namespace idol::test
