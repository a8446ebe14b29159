#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <map>

#include "idol/io/bag_writer.hpp"
#include "idol/io/trajectory_io.hpp"
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
    for (const char* file :
         {"states.csv", "trajectory_camera.txt", "trajectory_camera_causal.txt", "lines.csv"})
      results[name] += slurp(fs::path(out) / file);
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

// The RPG dataset's bags as they are: nothing but the bag.
TEST(Convert, BagOfADavis240cRunsWithNoOption) {
  const TempDir dir;
  const std::string bag = (dir.path() / "shapes.bag").string(), out = (dir.path() / "out").string();
  ASSERT_EQ(run_idol("convert " + kDemo + " " + bag + " --from 1 --to 2.5").status, 0);
  const auto run = run_idol("run " + bag + " --out " + out);
  EXPECT_EQ(run.status, 0) << run.err;
  expect_says(run.err, {"DAVIS240C", "RPG dataset", "--rig davis240c"});
  EXPECT_TRUE(fs::exists(fs::path(out) / "evaluation.json"));
  const auto named = run_idol("run " + bag + " --rig davis240c --out " + out);
  EXPECT_EQ(named.status, 0) << named.err;
  EXPECT_EQ(named.err.find("RPG dataset"), std::string::npos) << named.err;
}

TEST(Convert, CutOffFilesLeaveATrajectoryOfWhatCameBefore) {
  const TempDir dir;
  for (const std::string name : {"r.bag", "r.aedat4"}) {
    const std::string whole = (dir.path() / name).string(), out = (dir.path() / ("out_" + name)).string();
    ASSERT_EQ(run_idol("convert " + kDemo + " " + whole + " --from 1 --to 3").status, 0);
    const std::string bytes = slurp(whole);
    const auto cut = dir.write("cut_" + name, bytes.substr(0, bytes.size() * 7 / 10));
    const auto run = run_idol("run " + cut.string() + " --rig davis240c --out " + out);
    EXPECT_EQ(run.status, 1);
    expect_says(run.err, {"cut_" + name, "byte "});
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    const Trajectory poses = read_trajectory(fs::path(out) / "trajectory_camera.txt");
    EXPECT_GT(seconds_between(poses.front().t, poses.back().t), 0.8) << name;
    // The same through convert: what can be read is written.
    const auto converted = run_idol("convert " + cut.string() + " " + (dir.path() / "rest.h5").string());
    EXPECT_EQ(converted.status, 1);
    EXPECT_GT(read_back(dir.path() / "rest.h5").events.size(), 50'000u) << name;
  }
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

/// All of a recording, a row a line.
std::string recording_rows(const Packet& packet, const Trajectory& truth) {
  std::string text;
  for (const Event& e : packet.events) text += fmt::format("{} {} {} {:d}\n", e.t, e.x, e.y, e.polarity);
  const auto numbers = [&](const auto& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) text += fmt::format(" {:.17g}", values[i]);
  };
  for (const ImuSample& s : packet.imu) {
    text += fmt::format("{}", s.t);
    numbers(s.accel), numbers(s.gyro);
    text += '\n';
  }
  for (const StampedPose& pose : truth) {
    text += fmt::format("{}", pose.t);
    numbers(pose.T.p), numbers(pose.T.q.coeffs());
    text += '\n';
  }
  return text;
}

constexpr const char* kPrintRow = R"(
def row(t, *values): print(t, *('%.17g' % v for v in values))
)";

TEST(Convert, BagIsReadByRosbag) {
  const TempDir dir;
  if (!python_has(dir, "rosbag")) GTEST_SKIP() << "python3-rosbag is not installed";
  const fs::path bag = dir.path() / "r.bag";
  for (const BlockCodec codec : {BlockCodec::kNone, BlockCodec::kLz4, BlockCodec::kBzip2}) {
    BagWriter writer(bag, {240, 180}, codec);
    writer.add(some_packet());
    EXPECT_TRUE(writer.add_groundtruth(some_truth()));
    writer.close();
    const auto result = python(dir, std::string(kPrintRow) + R"(
import rosbag, sys
bag = rosbag.Bag(sys.argv[1])
for _, m, _ in bag.read_messages('/dvs/events'):
    for e in m.events: print(e.ts.to_nsec(), e.x, e.y, int(e.polarity))
for _, m, _ in bag.read_messages('/dvs/imu'):
    a, g = m.linear_acceleration, m.angular_velocity
    row(m.header.stamp.to_nsec(), a.x, a.y, a.z, g.x, g.y, g.z)
for _, m, _ in bag.read_messages('/optitrack/davis'):
    p, q = m.pose.position, m.pose.orientation
    row(m.header.stamp.to_nsec(), p.x, p.y, p.z, q.x, q.y, q.z, q.w)
)",
                               bag.string());
    EXPECT_TRUE(result.out == recording_rows(some_packet(), some_truth())) << result.out.substr(0, 300);
  }
}

// And bags that rosbag wrote: several topics of a kind, pictures, all three of its compressions.
TEST(Convert, RosbagFilesAreRead) {
  const TempDir dir;
  if (!python_has(dir, "rosbag, sensor_msgs.msg, nav_msgs.msg, geometry_msgs.msg"))
    GTEST_SKIP() << "python3-rosbag, -sensor-msgs, -nav-msgs or -geometry-msgs is not installed";
  const fs::path bag = dir.path() / "r.bag";
  for (const std::string codec : {"none", "bz2", "lz4"}) {
    const auto made = python(dir, R"(
import rosbag, sys, rospy, genpy.dynamic
from sensor_msgs.msg import Imu, Image
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
types = genpy.dynamic.generate_dynamic('dvs_msgs/EventArray', """std_msgs/Header header
uint32 height
uint32 width
dvs_msgs/Event[] events
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
================================================================================
MSG: dvs_msgs/Event
uint16 x
uint16 y
time ts
bool polarity
""")
array, event = types['dvs_msgs/EventArray'], types['dvs_msgs/Event']
with rosbag.Bag(sys.argv[1], 'w', compression=sys.argv[2], chunk_threshold=20000) as bag:
    for i in range(50):
        t = rospy.Time(1000, 20000000 * i)
        m = array(width=346, height=260)
        m.header.stamp = t
        m.events = [event(x=k, y=i, ts=t + rospy.Duration(0, 1000 * k), polarity=k % 2 == 1) for k in range(100)]
        bag.write('/dvs/events', m, t)
        for topic in ('/dvs/imu', '/other/imu'):
            imu = Imu()
            imu.header.stamp = t
            imu.linear_acceleration.z = 9.81 if topic == '/dvs/imu' else 1
            imu.angular_velocity.x = 0.125 * i
            bag.write(topic, imu, t)
        pose, odometry = TransformStamped(), Odometry()
        pose.header.stamp = odometry.header.stamp = t
        pose.transform.translation.y, pose.transform.rotation.w = i, 1
        odometry.pose.pose.position.z, odometry.pose.pose.orientation.w = i, 1
        bag.write('/vicon', pose, t)
        bag.write('/odometry', odometry, t)
        image = Image(width=2, height=1, encoding='mono8', step=2, data=bytes([i, 200]))
        image.header.stamp = t
        bag.write('/dvs/image_raw', image, t)
)",
                             bag.string() + " " + codec);
    ASSERT_EQ(made.status, 0) << made.out;
    expect_says(read_back(bag).error, {"/dvs/imu, /other/imu", "--imu-topic"});
    StreamChoice choice;
    choice.imu = "/dvs/imu";
    choice.truth = "/odometry";
    const ReadBack r = read_back(bag, choice);
    EXPECT_EQ(r.error, "");
    ASSERT_EQ(r.events.size(), 5000u);
    EXPECT_EQ(r.events[107], (Event{1'000'020'007'000, 7, 1, true}));
    ASSERT_EQ(r.imu.size(), 50u);
    EXPECT_EQ(r.imu[3].accel, Vec3(0, 0, 9.81));
    EXPECT_EQ(r.imu[3].gyro, Vec3(0.375, 0, 0));
    EXPECT_EQ(open_recording(bag, choice)->groundtruth()->at(4).T.p, Vec3(0, 0, 4));
    choice.truth = "/vicon";
    EXPECT_EQ(open_recording(bag, choice)->groundtruth()->at(4).T.p, Vec3(0, 4, 0));
    EXPECT_EQ(open_recording(bag)->resolution().width, 346);
    const auto frames = open_recording(bag)->frames();
    Frame frame;
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(frames->next(frame));
    EXPECT_EQ(frame.grey, (std::vector<std::uint8_t>{2, 200}));
  }
}

TEST(Convert, Hdf5IsReadByH5py) {
  const TempDir dir;
  if (!python_has(dir, "h5py")) GTEST_SKIP() << "python3-h5py is not installed";
  const fs::path file = dir.path() / "r.h5";
  for (const bool compress : {false, true}) {
    write(file, {some_packet()}, compress, some_truth());
    const auto result = python(dir, std::string(kPrintRow) + R"(
import h5py, sys
f = h5py.File(sys.argv[1])
assert list(f['idol_recording']) == [1, 240, 180]
e, imu, truth = f['events'], f['imu'], f['groundtruth']
for r in zip(e['t'][:], e['x'][:], e['y'][:], e['p'][:]): print(*r)
for t, a, g in zip(imu['t'][:], imu['accel'][:], imu['gyro'][:]): row(t, *a, *g)
for t, p, q in zip(truth['t'][:], truth['position'][:], truth['orientation'][:]): row(t, *p, *q)
)",
                               file.string());
    EXPECT_TRUE(result.out == recording_rows(some_packet(), some_truth())) << result.out.substr(0, 300);
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
