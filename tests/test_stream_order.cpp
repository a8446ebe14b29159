// Clocks that are set, and rows that come out of order, whatever the format.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "idol/base/input_check.hpp"
#include "idol/io/sensor_clock.hpp"
#include "idol/io/text_layout.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::expect_says;
using test::read_back;
using test::ReadBack;
using test::TempDir;

constexpr Time kMs = 1'000'000, kSecond = 1'000'000'000;

std::string stamp(Time t) {
  return fmt::format("{}{}.{:09}", t < 0 ? "-" : "", std::abs(t) / kSecond, std::abs(t) % kSecond);
}

/// 4 s of IMU at 200 Hz beside a few events, with stamps as `change` leaves them.
ReadBack read_imu(const std::function<void(std::vector<Time>&)>& change) {
  const TempDir dir;
  std::vector<Time> stamps;
  for (int i = 0; i < 800; ++i) stamps.push_back(1'700'000'000 * kSecond + i * 5 * kMs);
  change(stamps);
  std::string imu;
  for (std::size_t i = 0; i < stamps.size(); ++i)
    imu += fmt::format("{} 0 0 9.81 0 0 {}\n", stamp(stamps[i]), i);
  dir.write("imu.txt", imu);
  return read_back(dir.path());
}

/// 5 s of events 0.1 ms apart.
ReadBack read_events(const std::function<void(std::vector<Time>&)>& change) {
  const TempDir dir;
  std::vector<Time> stamps;
  for (int i = 0; i < 50'000; ++i) stamps.push_back(kSecond + i * kMs / 10);
  change(stamps);
  std::string text;
  for (std::size_t i = 0; i < stamps.size(); ++i)
    text += fmt::format("{} {} 1 1\n", stamp(stamps[i]), i % 240);
  return read_back(dir.write("events.txt", text));
}

std::int64_t count_of(const ReadBack& read, const std::string& kind) {
  const auto found = read.warnings.find(kind);
  return found == read.warnings.end() ? 0 : found->second.count;
}

TEST(StreamOrder, SwappedImuSamplesArePutBack) {
  const ReadBack read = read_imu([](std::vector<Time>& t) {
    for (std::size_t i = 20; i + 20 < t.size(); i += 60) std::swap(t[i], t[i + 1]);
    std::rotate(t.begin() + 400, t.begin() + 404, t.begin() + 408);  // two packets of four
  });
  EXPECT_EQ(read.error, "");
  EXPECT_EQ(read.imu.size(), 800U);
  EXPECT_TRUE(std::is_sorted(read.imu.begin(), read.imu.end(),
                             [](const auto& a, const auto& b) { return a.t < b.t; }));
  EXPECT_GT(count_of(read, "out_of_order_imu"), 10);
}

TEST(StreamOrder, AnImuClockThatIsSetBackIsAnErrorHoweverShortTheStep) {
  for (const Time back : {30 * kMs, 60 * kMs, 100 * kMs, 500 * kMs, kSecond, 10 * kSecond}) {
    const ReadBack read = read_imu([&](std::vector<Time>& t) {
      for (std::size_t i = 400; i < t.size(); ++i) t[i] -= back;
    });
    expect_says(read.error, {"imu.txt:401", "went back", "split"});
    EXPECT_GT(read.imu.size(), 380U) << "what came before is given out";
  }
}

TEST(StreamOrder, OneImuStampFarAheadIsDropped) {
  const ReadBack read = read_imu([](std::vector<Time>& t) { t[300] += 3600 * kSecond; });
  EXPECT_EQ(read.error, "");
  EXPECT_EQ(read.imu.size(), 799U);
}

TEST(StreamOrder, IsolatedLateEventsAreDropped) {
  const ReadBack read = read_events([](std::vector<Time>& t) {
    for (std::size_t i = 3000; i < t.size(); i += 4000) t[i] -= 99 * kMs;
  });
  EXPECT_EQ(read.error, "");
  EXPECT_EQ(read.events.size() + static_cast<std::size_t>(count_of(read, "out_of_order_event")), 50'000U);
}

TEST(StreamOrder, AnEventClockThatIsSetBackIsAnError) {
  for (const Time back : {20 * kMs, 90 * kMs, kSecond}) {
    const ReadBack read = read_events([&](std::vector<Time>& t) {
      for (std::size_t i = 25'000; i < t.size(); ++i) t[i] -= back;
    });
    expect_says(read.error, {"events.txt:25001", "went back", "split"});
  }
}

TEST(StreamOrder, SwappedPacketsOfEventsAreNoClock) {
  const ReadBack read = read_events(
      [](std::vector<Time>& t) { std::rotate(t.begin() + 20'000, t.begin() + 20'030, t.begin() + 20'060); });
  EXPECT_EQ(read.error, "");
  EXPECT_EQ(count_of(read, "out_of_order_event"), 30);
}

TEST(StreamOrder, RowsFromBeforeTheClockWasSetAreDroppedAndNamed) {
  for (const std::size_t rows : {1U, 20U}) {
    const ReadBack read = read_imu([&](std::vector<Time>& t) {
      for (std::size_t i = 0; i < rows; ++i) t[i] = static_cast<Time>(i) * kMs;
    });
    EXPECT_EQ(read.error, "");
    EXPECT_EQ(read.imu.size(), 800U - rows);
    EXPECT_EQ(count_of(read, "stamps_before_clock"), static_cast<std::int64_t>(rows));
  }
  const ReadBack ahead = read_events([](std::vector<Time>& t) {
    for (std::size_t i = 0; i < 50; ++i) t[i] += 1'000'000 * kSecond;
  });
  EXPECT_EQ(ahead.error, "");
  EXPECT_EQ(ahead.events.size(), 49'950U);
}

TEST(SensorClock, PlacesPacketsByManyStamps) {
  constexpr Time kOffset = 1'700'000'000 * kSecond;
  SensorClock clock;
  for (int i = 0; i < 101; ++i)
    clock.add(kOffset + i * 10 * kMs + (i == 0 ? 300 * kMs : 0), (5'000'000 + i * 10'000) % (1 << 24));
  EXPECT_EQ(clock.ros_time(5'000'000, kOffset + 300 * kMs), kOffset);
  EXPECT_EQ(clock.disagreement().messages, 1);
  EXPECT_NEAR(clock.disagreement().most_s, 0.3, 1e-9);
  for (const int gap_s : {5, 10, 17, 40, 3600}) {  // messages lost: any number of wraps
    const std::int64_t sensor = (5'000'000 + gap_s * std::int64_t{1'000'000}) % (1 << 24);
    EXPECT_EQ(clock.ros_time(sensor, kOffset + gap_s * kSecond + 2 * kMs), kOffset + gap_s * kSecond);
  }
}

TEST(TextLayout, ReadsTheUsualBeginnings) {
  const TempDir dir;
  const auto events_of = [&](const std::string& text) { return read_back(dir.write("e.txt", text)); };
  const std::vector<Event> wanted{{kSecond, 3, 4, true}, {2 * kSecond, 5, 6, false}};
  for (const std::string text :
       {"t,x,y,p\n1.0,3,4,1\n2.0,5,6,0\n", "240 180\n1.0 3 4 1\n2.0 5 6 0\n",
        "\xef\xbb\xbf# t x y p\n1.0 3 4 1\n2.0 5 6 0\n",
        "\xef\xbb\xbf"
        "1.0 3 4 1\n2.0 5 6 0\n",
        "1.0 3 4 True\n2.0 5 6 False\n", "%geometry:240,180\n3,4,1,1000000\n5,6,0,2000000\n",
        "3,4,1,1000000\n5,6,0,2000000\n", "x,y,polarity,t_us\n3,4,1,1000000\n5,6,0,2000000\n"}) {
    const ReadBack read = events_of(text);
    EXPECT_EQ(read.error, "") << text;
    EXPECT_EQ(read.events, wanted) << text;
  }
  expect_says(events_of("a,b,c,d\n1,2,3,1\n").error, {"e.txt:1", "names columns"});
}

TEST(TextLayout, WholeNumbersThatCannotBeSecondsAreOfAnotherUnit) {
  const TempDir dir;
  const auto read = [&](std::int64_t step) {
    std::string text;
    for (int i = 0; i < 2000; ++i) text += fmt::format("{} {} 1 1\n", i * step, i % 240);
    return read_back(dir.write("events.txt", text));
  };
  EXPECT_EQ(read(5).events.back().t, 1999 * Time{5'000}) << "200 000 a second in us";
  expect_says(read(100).error, {"events.txt", "unit cannot be told"});
  std::string imu;
  for (int i = 0; i < 100; ++i)
    imu += fmt::format("{} 0 0 9.81 0 0 {}\n", 1'700'000'000'000'000 + i * 5000, i);
  dir.write("imu.txt", imu);
  const ReadBack both = read_back(dir.path());
  (void)both;
  Diagnostics diagnostics;
  EXPECT_EQ(find_imu_layout(dir.path() / "imu.txt", diagnostics).stamp_ns, 1000);
  EXPECT_TRUE(diagnostics.entries().contains("stamp_unit"));
}

TEST(PushCheck, LeavesOutWhatCannotBeUsed) {
  PushCheck<Event> check(InputCheck<Event>(240, 180));
  Diagnostics diagnostics;
  const auto take = [&](Time t, int x = 1) {
    return check.take({t, static_cast<std::uint16_t>(x), 1, true}, diagnostics);
  };
  EXPECT_TRUE(take(5 * kSecond));
  EXPECT_FALSE(take(5 * kSecond, 240)) << "outside";
  EXPECT_FALSE(take(4 * kSecond)) << "back";
  EXPECT_FALSE(take(9000 * kSecond)) << "hours ahead";
  EXPECT_TRUE(take(6 * kSecond)) << "and on";
  EXPECT_EQ(diagnostics.entries().at("refused_event").count, 3);
  EXPECT_THROW(
      {
        for (int i = 0; i < 100; ++i) take(9000 * kSecond + i);
      },
      DataError)
      << "a clock that stays ahead";
  PushCheck<ImuSample> imu;
  EXPECT_FALSE(imu.take({kSecond, Vec3(0, NAN, 0), Vec3::Zero()}, diagnostics));
  EXPECT_TRUE(imu.take({kSecond, Vec3(0, 0, 9.81), Vec3::Zero()}, diagnostics));
}

}  // namespace
}  // namespace idol
