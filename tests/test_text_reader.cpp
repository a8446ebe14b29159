#include <fmt/format.h>

#include <algorithm>

#include "compress_util.hpp"
#include "idol/io/reader.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::expect_says;
using test::TempDir;

/// Everything a reader gives, and how it ended.
struct Recording {
  std::vector<Event> events;
  std::vector<ImuSample> imu;
  std::string error;
  Diagnostics diagnostics;
  Time first = 0;

  std::int64_t warnings(const std::string& kind) const {
    const auto entry = diagnostics.entries().find(kind);
    return entry == diagnostics.entries().end() ? 0 : entry->second.count;
  }
};

Recording read_all(const std::filesystem::path& path, const ReaderOptions& options) {
  Recording recording;
  std::unique_ptr<Reader> reader;
  try {
    reader = open_reader(path, options);
    recording.first = reader->first_stamp();
    while (auto packet = reader->next()) {
      EXPECT_FALSE(packet->events.empty() && packet->imu.empty());
      EXPECT_LE(packet->events.size(), options.packet_events);
      for (const Event& event : packet->events) recording.events.push_back(event);
      for (const ImuSample& sample : packet->imu) recording.imu.push_back(sample);
    }
    EXPECT_EQ(reader->next(), std::nullopt);
  } catch (const DataError& e) {
    recording.error = e.what();
    if (reader) {
      EXPECT_THROW(reader->next(), DataError);
    }
  }
  if (reader) recording.diagnostics = reader->diagnostics();
  EXPECT_TRUE(std::is_sorted(recording.events.begin(), recording.events.end(),
                             [](const Event& a, const Event& b) { return a.t < b.t; }));
  return recording;
}

ReaderOptions events_only(int width = 240, int height = 180) {
  ReaderOptions options;
  options.width = width;
  options.height = height;
  options.need_imu = false;
  return options;
}

/// `count` events, 0.1 ms apart from `from_s` on.
std::string some_events(int count, double from_s = 0) {
  std::string text;
  for (int i = 0; i < count; ++i)
    text += fmt::format("{:.9f} {} {} {}\n", from_s + 1e-4 * i, i % 240, i * 7 % 180, i % 2);
  return text;
}

std::string some_imu(int count, double from_s = 0) {
  std::string text;
  for (int i = 0; i < count; ++i) text += fmt::format("{:.9f} 0 0 9.81 0.1 -0.2 {}\n", from_s + 1e-3 * i, i);
  return text;
}

TEST(TextReader, ReadsEveryUsualWayToWriteARow) {
  const TempDir dir;
  dir.write("events.txt",
            "# t x y p\r\n2.097134001 162 27 0\r\n\r\n2.09714,77,45,1\n  # more\n2.097141001\t108\t160\t-1\n"
            "2.098e+00, 2.30e+02, 94.0, 1.0\n 2.0981  3 4 1  \n2.0982 5 6 +1");
  const Recording r = read_all(dir.path(), events_only());
  EXPECT_EQ(r.error, "");
  const std::vector<Event> expected = {{2'097'134'001, 162, 27, false},  {2'097'140'000, 77, 45, true},
                                       {2'097'141'001, 108, 160, false}, {2'098'000'000, 230, 94, true},
                                       {2'098'100'000, 3, 4, true},      {2'098'200'000, 5, 6, true}};
  EXPECT_EQ(r.events, expected);
  EXPECT_TRUE(r.diagnostics.entries().empty());
  EXPECT_EQ(r.first, 2'097'134'001);
}

TEST(TextReader, CompressionIsFoundByContentNotByName) {
  const std::string text = some_events(50000);
  const TempDir dir;
  const auto plain = read_all(dir.write("events.txt", text), events_only());
  ASSERT_EQ(plain.events.size(), 50000u);
  for (const std::string& bytes :
       {test::gzip(text), test::zstd(text), test::gzip(text.substr(0, 100)) + test::gzip(text.substr(100)),
        test::zstd(text.substr(0, 100)) + test::zstd(text.substr(100))}) {
    const auto r = read_all(dir.write("misnamed.txt", bytes), events_only());
    EXPECT_EQ(r.error, "");
    EXPECT_EQ(r.events, plain.events);
  }
}

TEST(TextReader, PacketSizeChangesNothing) {
  const TempDir dir;
  dir.write("events.txt", some_events(3000));
  dir.write("imu.txt", some_imu(400));
  ReaderOptions options;
  const auto reference = read_all(dir.path(), options);
  EXPECT_EQ(reference.imu.size(), 400u);
  for (const std::size_t size : {1, 7, 1000}) {
    options.packet_events = size;
    const auto r = read_all(dir.path(), options);
    EXPECT_EQ(r.events, reference.events);
    EXPECT_EQ(r.imu.size(), reference.imu.size());
  }
}

TEST(TextReader, ImuReachesBeyondTheEventsOfEachPacket) {
  const TempDir dir;
  dir.write("events.txt", some_events(3000));
  dir.write("imu.txt", some_imu(40000));
  ReaderOptions options;
  options.packet_events = 100;
  const auto reader = open_reader(dir.path(), options);
  Time covered = -1;
  std::size_t count = 0;
  while (auto packet = reader->next()) {
    if (!packet->imu.empty()) covered = packet->imu.back().t;
    count += packet->imu.size();
    EXPECT_LE(packet->imu.size(), 16384u);
    if (packet->events.empty()) continue;
    EXPECT_GT(covered, packet->events.back().t);
  }
  EXPECT_EQ(count, 40000u);
  EXPECT_EQ(reader->progress(), 1.0);
}

TEST(TextReader, SpansCountFromTheFirstStampOfAllStreams) {
  const TempDir dir;
  dir.write("events.txt", some_events(10000, 100.5));
  dir.write("imu.txt", some_imu(3000, 100.0));
  ReaderOptions options;
  options.from_s = 0.7;
  options.to_s = 1.2;
  for (const bool need_imu : {true, false}) {
    options.need_imu = need_imu;
    const auto r = read_all(dir.path(), options);
    EXPECT_EQ(r.first, 100'000'000'000);
    ASSERT_EQ(r.events.size(), 5000u);
    EXPECT_EQ(r.events.front().t, 100'700'000'000);
    EXPECT_EQ(r.events.back().t, 101'199'900'000);
    EXPECT_EQ(r.imu.empty(), !need_imu);
    if (need_imu) {
      EXPECT_EQ(r.imu.front().t, 100'600'000'000);
      EXPECT_EQ(r.imu.back().t, 101'299'000'000);
    }
  }
  options.from_s = 50;
  options.to_s = 60;
  expect_says(read_all(dir.path(), options).error, {"events.txt", "no events between 50 and 60 s"});
  options.from_s = 2;
  options.to_s = 2;
  EXPECT_THROW(open_reader(dir.path(), options), UsageError);
}

TEST(TextReader, ImuFarFromTheEventsIsLeftOutOnDemand) {
  const TempDir dir;
  dir.write("events.txt", some_events(1000, 20.0));
  dir.write("imu.txt", some_imu(60000));
  ReaderOptions options;
  options.imu_near_events = true;
  for (const std::size_t packet : {10, 16384}) {
    options.packet_events = packet;
    const auto r = read_all(dir.path(), options);
    EXPECT_EQ(r.error, "");
    EXPECT_EQ(r.first, 0);
    ASSERT_EQ(r.imu.size(), 300u);
    EXPECT_EQ(r.imu.front().t, 19'900'000'000);
    EXPECT_EQ(r.imu.back().t, 20'199'000'000);
  }
  // With the clocks apart, the samples beside the events are others.
  options.imu_offset_s = 5;
  const auto shifted = read_all(dir.path(), options);
  EXPECT_EQ(shifted.error, "");
  ASSERT_EQ(shifted.imu.size(), 300u);
  EXPECT_EQ(shifted.imu.front().t, 24'900'000'000);
  options.imu_offset_s = 100;
  expect_says(read_all(dir.path(), options).error, {"imu.txt ends before that, at 59.999", "overlap"});
}

TEST(TextReader, TellsWhenNoMoreImuComes) {
  const TempDir dir;
  dir.write("events.txt", some_events(3000));
  dir.write("imu.txt", some_imu(100));
  ReaderOptions options;
  options.packet_events = 100;
  const auto reader = open_reader(dir.path(), options);
  int before = 0, after = 0;
  while (const auto packet = reader->next()) ++(reader->imu_over() ? after : before);
  EXPECT_NEAR(before, 9, 2);
  EXPECT_EQ(before + after, 30);
}

TEST(TextReader, AClockThatJumpsAheadEndsTheRecording) {
  const TempDir dir;
  const auto r =
      read_all(dir.write("events.txt", some_events(1000) + some_events(1000, 1.5e9)), events_only());
  expect_says(r.error, {"events.txt:1002", "jump ahead", "0.099900", "1500000000"});
  EXPECT_EQ(r.events.size(), 1000u);
  EXPECT_EQ(
      read_all(dir.write("events.txt", some_events(1000) + some_events(1000, 500)), events_only()).error, "");
}

TEST(TextReader, IsolatedOddRowsAreSkippedAndCounted) {
  const TempDir dir;
  std::string text = some_events(5000);
  text += "nan 3 4 1\n0.5 240 4 1\n0.6 1 2 1\n0.61 1 2";
  const auto r = read_all(dir.write("events.txt", text), events_only());
  EXPECT_EQ(r.error, "");
  EXPECT_EQ(r.events.size(), 5001u);
  EXPECT_EQ(r.warnings("nan_row"), 1);
  EXPECT_EQ(r.warnings("outside_pixel"), 1);
  EXPECT_EQ(r.warnings("incomplete_last_row"), 1);
  expect_says(r.diagnostics.entries().at("outside_pixel").first_message,
              {"events.txt:5002", "(240, 4)", "240 x 180"});
}

TEST(TextReader, ManyOddRowsAreAnError) {
  const TempDir dir;
  const auto outside = read_all(dir.write("events.txt", some_events(50000)), events_only(128, 128));
  expect_says(outside.error, {"events.txt", "outside the sensor of 128 x 128", "rig"});
  EXPECT_LT(outside.events.size(), 20000u);

  std::string text = some_events(2500);
  for (int i = 0; i < 3; ++i) text += fmt::format("0.{} nan 4 1\n", 5 + i);
  const auto nan = read_all(dir.write("events.txt", text), events_only());
  expect_says(nan.error, {"events.txt", "3 of the first 2503 rows", "events.txt:2501"});
  EXPECT_EQ(nan.events.size(), 2500u);
}

TEST(TextReader, AShareOfOddRowsBelowOneInAThousandIsSurvived) {
  const TempDir dir;
  std::string text;
  for (int i = 0; i < 30; ++i)
    text += some_events(1500, 0.2 * i) + fmt::format("{} 9999 0 0\n", 0.2 * i + 0.19);
  const auto r = read_all(dir.write("events.txt", text), events_only());
  EXPECT_EQ(r.error, "");
  EXPECT_EQ(r.warnings("outside_pixel"), 30);
}

TEST(TextReader, AFewEventsOutOfOrderAreDropped) {
  const TempDir dir;
  const auto r = read_all(dir.write("events.txt",
                                    "1.0 1 1 0\n1.1 2 1 0\n1.0995 3 1 0\n1.1 4 1 0\n1.2 5 1 0\n1.15 6 1 0\n"
                                    "1.3 7 1 0\n"),
                          events_only());
  EXPECT_EQ(r.error, "");
  EXPECT_EQ(r.warnings("out_of_order_event"), 2);
  ASSERT_EQ(r.events.size(), 5u);
  EXPECT_EQ(r.events[2].x, 4);  // equal stamps of different events are normal
}

TEST(TextReader, OneStampFarAheadDoesNotSwallowTheRest) {
  const TempDir dir;
  for (const std::size_t packet : {1, 2, 3, 16384}) {
    auto options = events_only();
    options.packet_events = packet;
    const auto r = read_all(
        dir.write("events.txt", some_events(10) + "99999.5 1 1 0\n" + some_events(10, 0.01)), options);
    EXPECT_EQ(r.error, "");
    EXPECT_EQ(r.events.size(), 20u);
    EXPECT_EQ(r.warnings("out_of_order_event"), 1);
  }
}

TEST(TextReader, StampsThatGoBackAgainAndAgainAreAnError) {
  const TempDir dir;
  std::string text;
  for (int i = 0; i < 40; ++i)
    text += fmt::format("{:.6f} 1 1 0\n{:.6f} 2 1 0\n", 1 + 0.01 * i, 1 + 0.01 * i - 0.0015);
  const auto jumping = read_all(dir.write("events.txt", text), events_only());
  expect_says(jumping.error, {"events.txt:", "again and again"});
  EXPECT_GE(jumping.events.size(), 10u);

  const auto reset =
      read_all(dir.write("events.txt", some_events(2000, 50) + some_events(2000)), events_only());
  expect_says(reset.error, {"events.txt:2001", "stay behind"});
  EXPECT_EQ(reset.events.size(), 2000u);
}

TEST(TextReader, OddImuRows) {
  const TempDir dir;
  dir.write("events.txt", some_events(1000));
  dir.write("imu.txt",
            some_imu(50) + "0.049 1 1 1 1 1 1\n0.0485 1 1 1 1 1 1\nnan 0 0 9 0 0 0\n" + some_imu(100, 0.05));
  const auto r = read_all(dir.path(), {});
  EXPECT_EQ(r.error, "");
  EXPECT_EQ(r.imu.size(), 151u) << "the late one is put in its place";
  EXPECT_EQ(r.warnings("duplicate_imu_stamp"), 1);
  EXPECT_EQ(r.warnings("out_of_order_imu"), 1);
  EXPECT_EQ(r.warnings("nan_row"), 1);
}

TEST(TextReader, CutOffCompressionGivesWhatCameBefore) {
  const std::string text = some_events(200000);
  const TempDir dir;
  const auto whole = read_all(dir.write("events.txt", text), events_only());
  for (const std::string& bytes : {test::gzip(text), test::zstd(text)}) {
    for (const double share : {0.3, 0.7, 0.999}) {
      const auto size = static_cast<std::size_t>(share * static_cast<double>(bytes.size()));
      const auto r = read_all(dir.write("events.txt.x", bytes.substr(0, size)), events_only());
      expect_says(r.error, {"events.txt.x", "cut off"});
      EXPECT_GT(static_cast<double>(r.events.size()), (share - 0.25) * 200000);
      EXPECT_TRUE(std::equal(r.events.begin(), r.events.end(), whole.events.begin()));
    }
    for (const std::size_t size : {5, 12, 20}) {
      EXPECT_NE(read_all(dir.write("events.txt.x", bytes.substr(0, size)), events_only()).error, "");
    }
    std::string flipped = bytes;
    for (std::size_t i = flipped.size() / 2; i < flipped.size() / 2 + 40; ++i) flipped[i] ^= 0x55;
    const auto r = read_all(dir.write("events.txt.x", flipped), events_only());
    EXPECT_NE(r.error, "");
    EXPECT_GT(r.events.size(), 20000u);
  }
}

TEST(TextReader, FilesThatAreNoRecording) {
  const TempDir dir;
  const auto error = [&](const std::string& content) {
    return read_all(dir.write("events.txt", content), events_only()).error;
  };
  expect_says(error(""), {"events.txt", "empty"});
  expect_says(error("# t x y p\n\n"), {"events.txt", "no event"});
  expect_says(error("0.1 1 2\n0.2 1 2\n"), {"events.txt:1", "3 columns where 4 are expected"});
  expect_says(error("0.1 1 2 0\n0.2 1 2 0 5\n"), {"events.txt:2", "5 columns"});
  expect_says(error("t,x,y,z\n0.2 1 2 0\n"), {"events.txt:1", "names columns"});
  expect_says(error("0.1 1.5 2 0\n"), {"events.txt:1", "raw"});
  expect_says(error("0.1 1 2 7\n"), {"events.txt:1", "polarity"});
  expect_says(error("1468939993067416019 1 2 1\n"), {"events.txt:1", "nanoseconds"});
  expect_says(error(std::string("0.1 1 2 0\n\x01\x02\x00\xff\n", 15)), {"events.txt:2", "binary"});
  expect_says(error("#!AER-DAT4.0\r\n\x01\x02"), {"events.txt", "cut off"});
  expect_says(error("#!AER-DAT3.1\r\n"), {"events.txt", "AEDAT"});
  expect_says(error("\x89HDF\r\n\x1a\n"), {"events.txt", "HDF5"});
  std::mt19937 rng(3);
  std::string garbage(1 << 20, '\0');
  for (char& c : garbage) c = static_cast<char>(rng());
  EXPECT_NE(error(garbage), "");
  EXPECT_NE(error(std::string(1 << 20, '\0')), "");
  expect_says(error(std::string(1 << 20, '7')), {"events.txt:1", "not a text recording"});
}

TEST(TextReader, MissingFiles) {
  const TempDir dir;
  expect_says(read_all(dir.path() / "absent", {}).error, {"absent", "no such file"});
  expect_says(read_all(dir.path(), {}).error, {"no events.txt"});
  dir.write("events.txt", some_events(1000));
  expect_says(read_all(dir.path(), {}).error, {"no imu.txt"});
  expect_says(read_all(dir.path() / "events.txt", {}).error, {"no imu.txt"});
  dir.write("imu.txt", "");
  expect_says(read_all(dir.path(), {}).error, {"imu.txt", "empty"});
  EXPECT_EQ(read_all(dir.path(), events_only()).events.size(), 1000u);
  auto options = events_only();
  options.imu_if_present = true;
  expect_says(read_all(dir.path(), options).error, {"imu.txt", "empty"});
}

TEST(TextReader, DamagedImuEndsTheRecordingAfterWhatCameBefore) {
  const TempDir dir;
  dir.write("events.txt", some_events(2000));
  dir.write("imu.txt", some_imu(100) + "0.1 0 0\n" + some_imu(100, 0.2));
  ReaderOptions options;
  options.packet_events = 100;
  const auto r = read_all(dir.path(), options);
  expect_says(r.error, {"imu.txt:101", "3 columns where 7"});
  EXPECT_EQ(r.imu.size(), 100u);
  EXPECT_GE(r.events.size(), 990u);
  EXPECT_LE(r.events.size(), 1100u);
}

TEST(TextReader, StreamsThatDoNotOverlap) {
  const TempDir dir;
  dir.write("events.txt", some_events(1000, 100));
  dir.write("imu.txt", some_imu(1000, 1.4e9));
  const auto later = read_all(dir.path(), {});
  expect_says(later.error, {"events.txt", "imu.txt", "overlap"});
  EXPECT_TRUE(later.events.empty());
  dir.write("imu.txt", some_imu(1000));
  expect_says(read_all(dir.path(), {}).error, {"events.txt", "imu.txt ends before", "overlap"});
  // The IMU may end early, as long as it was there.
  dir.write("imu.txt", some_imu(1000, 99.05));
  EXPECT_EQ(read_all(dir.path(), {}).error, "");
}

TEST(TextReader, RealRecordings) {
  const std::filesystem::path data = IDOL_SHARED_DATA_DIR;
  if (!std::filesystem::exists(data)) GTEST_SKIP() << data << " is not there";
  auto options = events_only();
  options.imu_if_present = true;
  const auto rotation = read_all(data / "real/rpg_shapes_rotation", options);
  EXPECT_EQ(rotation.error, "");
  EXPECT_EQ(rotation.events.size(), 20000u);
  EXPECT_EQ(rotation.imu.size(), 59667u);
  EXPECT_EQ(rotation.events[1], (Event{2'097'140'000, 77, 45, false}));
  EXPECT_EQ(read_all(data / "real/rpg_shapes_6dof_start", options).events.size(), 34634u);
  EXPECT_EQ(read_all(data / "real/rpg_slider_depth/events.txt", options).events.size(), 50000u);
  options.need_imu = true;
  const auto sim = read_all(data / "sim/shapes_translation", options);
  EXPECT_EQ(sim.events.size(), 1915916u);
  EXPECT_EQ(sim.imu.size(), 12011u);
  EXPECT_TRUE(sim.diagnostics.entries().empty());
  for (const char* name : {"real/rpg_shapes_rotation", "real/rpg_poster_6dof", "sim/room_6dof"})
    EXPECT_GT(read_groundtruth(data / name)->size(), 1000u);
  EXPECT_EQ(read_groundtruth(data / "real/rpg_shapes_6dof_start"), std::nullopt);
}

}  // namespace
}  // namespace idol
