#include "idol/imu/imu_bursts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "idol/imu/imu_buffer.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

constexpr double kPeriod = 1.242e6;  // [ns], as a DVXplorer measures

Time true_time(int k) { return 1'700'000'000'000'000'000 + std::llround(kPeriod * k); }

/// Sample `k`, whose reading tells which it is.
ImuSample sample(int k, Time stamp) { return {stamp, Vec3(k, 0, 9.81), Vec3(0, 0.001 * k, 0)}; }
int number_of(const ImuSample& s) { return static_cast<int>(std::lround(s.accel.x())); }

/// `count` samples, `sizes` of them together in turn, each burst with the stamp of its last sample. `step_ns`
/// lies between the stamps of a burst.
std::vector<ImuSample> in_bursts(int count, const std::vector<int>& sizes, Time step_ns = 0) {
  std::vector<ImuSample> samples;
  for (std::size_t b = 0; std::ssize(samples) < count; ++b) {
    const int begin = static_cast<int>(samples.size());
    const int end = std::min(count, begin + sizes[b % sizes.size()]);
    for (int k = begin; k < end; ++k)
      samples.push_back(sample(k, true_time(end - 1) - (end - 1 - k) * step_ns));
  }
  return samples;
}

/// About `count` samples that are fetched every 4 ms, and stamped up to `jitter_ns` later than that.
std::vector<ImuSample> fetched(int count, double jitter_ns) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> jitter(0, jitter_ns);
  std::vector<ImuSample> samples;
  std::int64_t fetch = 0;
  Time stamp = 0;
  for (int k = 0; k < count; ++k) {
    const auto next = static_cast<std::int64_t>(std::ceil(kPeriod * k / 4e6));
    if (k == 0 || next > fetch)
      stamp = true_time(0) + std::llround(4e6 * static_cast<double>(next) + jitter(rng));
    fetch = next;
    samples.push_back(sample(k, stamp));
  }
  std::erase_if(samples, [&](const ImuSample& s) { return s.t == stamp; });  // perhaps not complete
  return samples;
}

ImuBursts::Output spread(const std::vector<ImuSample>& samples, ImuBursts* bursts = nullptr) {
  ImuBursts own;
  ImuBursts& used = bursts != nullptr ? *bursts : own;
  ImuBursts::Output out;
  for (const ImuSample& s : samples) used.push(s, out);
  used.flush(out);
  return out;
}

void expect_equal(const std::vector<ImuSample>& a, const std::vector<ImuSample>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].t, b[i].t) << i;
    ASSERT_EQ(a[i].accel, b[i].accel) << i;
    ASSERT_EQ(a[i].gyro, b[i].gyro) << i;
  }
}

/// Largest error of the samples' times [periods].
double largest_error(const std::vector<ImuSample>& samples) {
  double largest = 0;
  for (const ImuSample& s : samples)
    largest = std::max(largest, std::abs(static_cast<double>(s.t - true_time(number_of(s)))) / kPeriod);
  return largest;
}

/// Shortest and longest distance of two samples that follow each other [periods].
std::pair<double, double> distances(const std::vector<ImuSample>& samples) {
  std::pair<double, double> range{1e9, 0};
  for (std::size_t i = 1; i < samples.size(); ++i) {
    if (number_of(samples[i]) != number_of(samples[i - 1]) + 1) continue;
    const double distance = static_cast<double>(samples[i].t - samples[i - 1].t) / kPeriod;
    range = {std::min(range.first, distance), std::max(range.second, distance)};
  }
  return range;
}

std::string warning_of(const ImuBursts& bursts) {
  Diagnostics diagnostics;
  bursts.report("", diagnostics);
  const auto entry = diagnostics.entries().find("imu_bursts");
  return entry == diagnostics.entries().end() ? "" : entry->second.first_message;
}

TEST(ImuBursts, ThreeAndFourInTurnGetTheirTrueTimes) {
  for (const std::vector<int>& sizes : {std::vector{3, 4}, {4}, {2}, {3, 3, 4, 1, 3}, {1, 2}, {12}}) {
    ImuBursts bursts;
    const auto out = spread(in_bursts(2000, sizes), &bursts);
    ASSERT_EQ(out.samples.size(), 2000U);
    EXPECT_TRUE(out.repeats.empty());
    EXPECT_EQ(bursts.spread(), 2000);
    EXPECT_LT(largest_error(out.samples), 0.01) << sizes.front();
  }
}

TEST(ImuBursts, SaysWhatItDid) {
  ImuBursts bursts;
  spread(in_bursts(2000, {3, 4}), &bursts);
  EXPECT_EQ(warning_of(bursts),
            "IMU rows came in bursts of 3 to 4 with one stamp: they were spread at 805 Hz");
  ImuBursts near;
  spread(in_bursts(1000, {4}, 10'000), &near);
  EXPECT_EQ(warning_of(near),
            "IMU rows came in bursts of 4 with nearly one stamp: they were spread at 805 Hz");
  EXPECT_EQ(warning_of(ImuBursts()), "");
}

TEST(ImuBursts, StampsOfArrivalAreSmoothed) {
  for (const double jitter : {0.0, 0.2e6, 0.5e6}) {
    const auto samples = fetched(5000, jitter);
    const auto out = spread(samples);
    ASSERT_EQ(out.samples.size(), samples.size());
    // Later by the mean of the jitter: nothing tells of it.
    EXPECT_LT(largest_error(out.samples), 0.5 + 0.5 * jitter / kPeriod) << jitter;
    EXPECT_GT(distances(out.samples).first, 0.8) << jitter;
    EXPECT_LT(distances(out.samples).second, 1.2) << jitter;
  }
}

TEST(ImuBursts, WildStampsStillGiveTimesThatIncrease) {
  std::mt19937 rng(5);
  std::vector<ImuSample> samples;
  Time stamp = 0;
  for (int b = 0; b < 2000; ++b) {
    stamp += 1 + static_cast<Time>(rng() % (b % 100 == 0 ? 300'000'000 : 8'000'000));
    for (auto n = 1 + rng() % 6; n > 0; --n)
      samples.push_back(sample(static_cast<int>(samples.size()), stamp));
  }
  const auto out = spread(samples);
  EXPECT_EQ(out.samples.size(), samples.size());
  for (std::size_t i = 1; i < out.samples.size(); ++i) {
    ASSERT_GT(out.samples[i].t, out.samples[i - 1].t);
    ASSERT_LT(std::abs(seconds_between(out.samples[i].t, samples[i].t)), 0.05);
  }
}

TEST(ImuBursts, LostPacketsLeaveAGap) {
  for (const bool arrival : {false, true}) {
    auto samples = arrival ? fetched(4000, 0) : in_bursts(4000, {3, 4});
    std::vector<ImuSample> kept;
    for (std::size_t begin = 0; begin < samples.size();) {  // whole bursts
      std::size_t end = begin;
      while (end < samples.size() && samples[end].t == samples[begin].t) ++end;
      const bool lost =
          (begin > 20 && begin < 25) || (begin > 700 && begin < 710) || (begin > 2000 && begin < 2500);
      if (!lost)
        kept.insert(kept.end(), samples.begin() + static_cast<std::ptrdiff_t>(begin),
                    samples.begin() + static_cast<std::ptrdiff_t>(end));
      begin = end;
    }
    ASSERT_LT(kept.size(), 3500U);
    const auto out = spread(kept);
    ASSERT_EQ(out.samples.size(), kept.size());
    // How many periods a gap lasted is known to about one where stamps are of the arrival; the clock comes
    // back soon.
    EXPECT_LT(largest_error(out.samples), arrival ? 1.25 : 0.01);
    const auto wrong = std::count_if(out.samples.begin(), out.samples.end(),
                                     [](const ImuSample& s) { return largest_error({s}) > 0.5; });
    EXPECT_LT(wrong, arrival ? 40 : 1);
  }
}

TEST(ImuBursts, RepeatsAreDropped) {
  auto samples = in_bursts(600, {3, 4});
  auto doubled = samples;
  for (const int at : {500, 300, 10})
    doubled.insert(doubled.begin() + at, samples[static_cast<std::size_t>(at)]);
  const auto out = spread(doubled);
  EXPECT_EQ(out.repeats.size(), 3U);
  expect_equal(out.samples, spread(samples).samples);

  // Each one twice is no burst.
  std::vector<ImuSample> regular, twice;
  for (int k = 0; k < 300; ++k) {
    regular.push_back(sample(k, true_time(k)));
    twice.insert(twice.end(), 2, regular.back());
  }
  ImuBursts bursts;
  const auto single = spread(twice, &bursts);
  EXPECT_EQ(single.repeats.size(), 300U);
  EXPECT_EQ(bursts.spread(), 0);
  expect_equal(single.samples, regular);
}

TEST(ImuBursts, WithoutBurstsNothingChanges) {
  std::mt19937 rng(7);
  std::vector<ImuSample> samples;
  for (int k = 0; k < 3000; ++k) {
    if ((k > 5 && k < 9) || (k > 400 && k < 600) || (k > 1000 && k % 40 < 10)) continue;  // gaps
    samples.push_back(sample(k, true_time(k) + static_cast<Time>(rng() % 800'000)));
  }
  ImuBursts bursts;
  auto out = spread(samples, &bursts);
  EXPECT_EQ(bursts.spread(), 0);
  expect_equal(out.samples, samples);

  // An isolated second reading with one stamp is dropped, as it always was.
  auto with_seconds = samples;
  for (const int at : {2000, 1000, 12}) {
    ImuSample second = samples[static_cast<std::size_t>(at)];
    second.gyro.z() = 1;
    with_seconds.insert(with_seconds.begin() + at + 1, second);
  }
  out = spread(with_seconds);
  EXPECT_EQ(out.repeats.size(), 3U);
  expect_equal(out.samples, samples);

  for (const std::size_t few : {0, 1, 2, 5, 9, 15, 16, 17}) {
    const std::vector<ImuSample> start(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(few));
    expect_equal(spread(start).samples, start);
  }
}

TEST(ImuBursts, WhatWasSpreadIsNotSpreadAgain) {
  for (const auto& samples : {in_bursts(2000, {3, 4}), fetched(2000, 0.5e6)}) {
    const auto once = spread(samples);
    ImuBursts again;
    expect_equal(spread(once.samples, &again).samples, once.samples);
    EXPECT_EQ(again.spread(), 0);
  }
}

TEST(ImuBursts, NearlyOneStampIsTheSame) {
  const auto out = spread(in_bursts(2000, {4}, 10'000));
  ASSERT_EQ(out.samples.size(), 2000U);
  EXPECT_LT(largest_error(out.samples), 0.01);
}

TEST(ImuBursts, MayBeginInTheMiddle) {
  auto samples = in_bursts(4000, {3, 4});
  for (int k = 0; k < 1000; ++k) samples[static_cast<std::size_t>(k)].t = true_time(k);
  ImuBursts bursts;
  const auto out = spread(samples, &bursts);
  EXPECT_GT(bursts.spread(), 2900);
  EXPECT_EQ(out.samples.size() + out.repeats.size(), 4000U);
  EXPECT_LT(out.repeats.size(), 30U);  // until it is clear that these are bursts
  for (std::size_t i = 1; i < out.samples.size(); ++i) ASSERT_GT(out.samples[i].t, out.samples[i - 1].t);
  EXPECT_LT(largest_error({out.samples.end() - 2500, out.samples.end()}), 0.1);
}

TEST(ImuBursts, ManySamplesWithOneStampAreDropped) {
  std::vector<ImuSample> samples;
  for (int k = 0; k < 100'000; ++k) samples.push_back(sample(k, true_time(0)));
  EXPECT_EQ(spread(samples).samples.size(), 1U);
  samples = in_bursts(1000, {3, 4});
  const auto more = [&] { return sample(static_cast<int>(samples.size()), samples.back().t); };
  while (samples.size() < 100'000) samples.push_back(more());
  EXPECT_LT(spread(samples).samples.size(), 1200U);
}

TEST(ImuBursts, HoldBackNoMoreThanTheOpenBurst) {
  ImuBursts bursts;
  ImuBursts::Output out;
  const auto samples = in_bursts(1000, {3, 4});
  for (std::size_t i = 0; i < samples.size(); ++i) {
    bursts.push(samples[i], out);
    if (i <= 128) continue;  // the beginning
    ASSERT_LE(i + 1 - out.samples.size(), 4U);
  }
}

// The live door has the same check as files.
TEST(ImuBuffer, SpreadsBursts) {
  ImuBuffer buffer;
  const auto samples = in_bursts(1000, {3, 4});
  for (std::size_t i = 0; i < samples.size(); ++i) {
    buffer.push(samples[i]);
    if (i == 500) buffer.push(samples[i]);
    if (i == 700) buffer.push(samples[i - 10]);
  }
  buffer.flush();
  expect_equal(buffer.slice(true_time(-10), true_time(2000), 0), spread(samples).samples);
  const auto& entries = buffer.diagnostics().entries();
  EXPECT_EQ(entries.at("imu_bursts").count, 1000);
  EXPECT_EQ(entries.at("imu_stamp_not_increasing").count, 2);
}

class BurstRecording : public ::testing::Test {
 protected:
  void write(const std::vector<ImuSample>& samples) {
    std::string events, imu;
    for (int i = 0; i < 20000; ++i) {
      const Time t = true_time(0) + i * Time{100'000};
      events +=
          fmt::format("{}.{:09d} {} {} {}\n", t / 1'000'000'000, t % 1'000'000'000, i % 240, i % 180, i % 2);
    }
    for (const ImuSample& s : samples)
      imu += fmt::format("{}.{:09d} {} 0 9.81 0 {} 0\n", s.t / 1'000'000'000, s.t % 1'000'000'000,
                         s.accel.x(), s.gyro.y());
    dir_.write("events.txt", events);
    dir_.write("imu.txt", imu);
  }
  std::vector<ImuSample> read(std::size_t packet_events) {
    ReaderOptions options;
    options.packet_events = packet_events;
    const auto reader = open_reader(dir_.path(), options);
    std::vector<ImuSample> samples;
    while (const auto packet = reader->next())
      samples.insert(samples.end(), packet->imu.begin(), packet->imu.end());
    diagnostics_ = reader->diagnostics();
    return samples;
  }

  test::TempDir dir_;
  Diagnostics diagnostics_;
};

TEST_F(BurstRecording, IsReadTheSameInAnyPackets) {
  auto samples = in_bursts(1600, {3, 4});
  const auto expected = spread(samples).samples;
  samples.insert(samples.begin() + 800, samples[799]);
  write(samples);
  for (const std::size_t packet : {1, 37, 1000, 100'000}) {
    expect_equal(read(packet), expected);
    const auto& entries = diagnostics_.entries();
    EXPECT_EQ(entries.at("imu_bursts").count, 1600);
    test::expect_says(entries.at("imu_bursts").first_message, {"imu.txt: IMU rows", "3 to 4", "805 Hz"});
    EXPECT_EQ(entries.at("duplicate_imu_stamp").count, 1);
    test::expect_says(entries.at("duplicate_imu_stamp").first_message, {"imu.txt:801:"});
  }
}

TEST_F(BurstRecording, DamageComesAfterAllSamplesBefore) {
  write(in_bursts(1600, {3, 4}));
  std::ofstream(dir_.path() / "imu.txt", std::ios::app) << "1700000009 0 0\n1700000010 0 0 9 0 0 0\n";
  const auto r = test::read_back(dir_.path());
  test::expect_says(r.error, {"imu.txt:1601"});
  expect_equal(r.imu, spread(in_bursts(1600, {3, 4})).samples);
}

TEST_F(BurstRecording, ConvertedOneHasTheSpreadTimes) {
  write(in_bursts(1600, {3, 4}));
  const test::TempDir elsewhere;
  const std::string out = (elsewhere.path() / "out").string();
  const auto result = test::run_idol(fmt::format("convert '{}' '{}'", dir_.path().string(), out));
  EXPECT_EQ(result.status, 0) << result.err;
  const auto back = test::read_back(out);
  expect_equal(back.imu, spread(in_bursts(1600, {3, 4})).samples);
  EXPECT_EQ(back.warnings.count("imu_bursts"), 0U);
}

TEST_F(BurstRecording, InfoTells) {
  write(in_bursts(1600, {3, 4}));
  const auto info = test::run_idol(fmt::format("info '{}'", dir_.path().string()));
  EXPECT_EQ(info.status, 0) << info.err;
  test::expect_says(info.out, {"1600 samples", "805.2 Hz", "IMU rows came in bursts of 3 to 4 with one stamp",
                               "1600 x imu_bursts"});
}

TEST(ImuBursts, RealRecordingsOfADvxplorer) {
  const std::filesystem::path data = std::filesystem::path(IDOL_SHARED_DATA_DIR) / "real";
  const auto bursts = data / "dvxplorer_micro/static.aedat4",
             regular = data / "aedat4/tonic_dvxplorer.aedat4";
  if (!std::filesystem::exists(bursts) || !std::filesystem::exists(regular))
    GTEST_SKIP() << "the recordings are not there: " << bursts << ", " << regular;
  const auto spread_out = test::read_back(bursts);
  EXPECT_EQ(spread_out.error, "");
  ASSERT_EQ(spread_out.imu.size(), 5616U);
  EXPECT_EQ(spread_out.warnings.at("imu_bursts").count, 5616);
  test::expect_says(spread_out.warnings.at("imu_bursts").first_message,
                    {"bursts of 3 to 4 with one stamp", "80"});
  EXPECT_EQ(spread_out.warnings.count("duplicate_imu_stamp"), 0U);
  std::vector<Time> steps;
  for (std::size_t i = 1; i < spread_out.imu.size(); ++i)
    steps.push_back(spread_out.imu[i].t - spread_out.imu[i - 1].t);
  std::sort(steps.begin(), steps.end());
  EXPECT_GT(steps.front(), 0.5 * kPeriod);
  EXPECT_NEAR(static_cast<double>(steps[steps.size() / 2]), kPeriod, 0.02 * kPeriod);
  EXPECT_LT(static_cast<double>(steps[steps.size() * 99 / 100]), 1.1 * kPeriod);

  const auto untouched = test::read_back(regular);
  EXPECT_EQ(untouched.error, "");
  EXPECT_EQ(untouched.imu.size(), 475U);
  EXPECT_EQ(untouched.warnings.count("imu_bursts"), 0U);
}

}  // namespace
}  // namespace idol
