#include "idol/image/flicker_filter.hpp"

#include <algorithm>
#include <cmath>

#include "pipeline_util.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

struct Lamp {
  double hz = 100, width = 1, probability = 0.2;
  double from_s = 0, to_s = 1.5;
  double drift_hz = 0;     // the frequency wanders by so much about `hz`
  double irregular = 0;    // half periods are longer or shorter by up to this share, at random
  double spread = 0.2;     // of a half period: how late events are [standard deviation]
  double radius_px = 1e9;  // about the image's middle
};

struct Size {
  int width = 240, height = 180;
};

// An event, and of what it is.
struct Made {
  Event event;
  bool flicker = false;
};
using Stream = std::vector<Made>;

Time time_of(double t_s) { return from_seconds(t_s) / 1000 * 1000; }

void add_lamp(Stream& stream, const Lamp& lamp, Size size = {}) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal(0, 1);
  bool on = true;
  for (double t = lamp.from_s; t < lamp.to_s; on = !on) {
    const double half = 0.5 / (lamp.hz + lamp.drift_hz * std::sin(2 * t));
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width * lamp.width; ++x) {
        if (uniform(rng) >= lamp.probability) continue;
        if (std::hypot(x - size.width / 2, y - size.height / 2) > lamp.radius_px) continue;
        const Event event{time_of(t + std::abs(normal(rng)) * lamp.spread * half),
                          static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), on};
        stream.push_back({event, true});
      }
    t += half * (1 + lamp.irregular * (2 * uniform(rng) - 1));
  }
}

// Nearly upright edges of both polarities that move to and fro, each a pixel at a time. `lit_hz`: a weak lamp
// decides when their events come, ON while its light grows.
void add_edges(Stream& stream, double duration_s, Size size = {}, double lit_hz = 0) {
  std::mt19937 rng(11);
  std::uniform_real_distribution<double> uniform(0, 1);
  constexpr double kStep_s = 1e-3, kSlant = 0.2;
  for (int k = 0; k < 6; ++k) {
    const double middle = size.width * (k + 0.5) / 6, reach = size.width / 20.0, rate = 13 + k;
    const auto place = [&](double t) { return middle + reach * std::sin(rate * t + k); };
    for (double t = 0; t < duration_s; t += kStep_s) {
      const bool on = (place(t + kStep_s) > place(t)) == (k % 2 == 0);
      for (int y = size.height / 10; y < size.height * 9 / 10; ++y) {
        const double a = place(t) + kSlant * (y - size.height / 2), b = a + place(t + kStep_s) - place(t);
        for (int x = static_cast<int>(std::ceil(std::min(a, b))); x < std::max(a, b); ++x) {
          if (x < 0 || x >= size.width) continue;
          double at = t + kStep_s * uniform(rng);
          if (lit_hz > 0) at = (std::floor(at * lit_hz) + (on ? 0 : 0.5) + 0.2 * uniform(rng)) / lit_hz;
          stream.push_back(
              {{time_of(at), static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), on}, false});
        }
      }
    }
  }
}

void add_noise(Stream& stream, double duration_s, double rate, Size size = {}) {
  std::mt19937 rng(13);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (double t = 0; t < duration_s; t -= std::log(1 - uniform(rng)) / rate)
    stream.push_back(
        {{time_of(t), static_cast<std::uint16_t>(rng() % static_cast<unsigned>(size.width)),
          static_cast<std::uint16_t>(rng() % static_cast<unsigned>(size.height)), rng() % 2 == 0},
         false});
}

Stream edges_and_noise(double duration_s, Size size = {}) {
  Stream stream;
  add_edges(stream, duration_s, size);
  add_noise(stream, duration_s, 5000, size);
  return stream;
}

struct Result {
  double flicker_removed = 0, own_removed = 0;  // shares
  std::vector<Event> removed;
  double frequency_hz = 0;
};

Result filter(Stream stream, Size size = {}) {
  std::stable_sort(stream.begin(), stream.end(),
                   [](const Made& a, const Made& b) { return a.event.t < b.event.t; });
  FlickerFilter flicker_filter(size.width, size.height);
  Result out;
  std::size_t next = 0;
  std::array<double, 2> all{}, removed{};
  const auto take = [&](const Event& event, bool is_flicker) {
    ASSERT_EQ(event, stream[next].event);  // each once, in order
    const std::size_t kind = stream[next++].flicker ? 1 : 0;
    ++all[kind];
    if (!is_flicker) return;
    ++removed[kind];
    out.removed.push_back(event);
  };
  for (const Made& made : stream) flicker_filter.push(made.event, take);
  flicker_filter.finish(take);
  EXPECT_EQ(next, stream.size());
  out.own_removed = removed[0] / std::max(1.0, all[0]);
  out.flicker_removed = removed[1] / std::max(1.0, all[1]);
  out.frequency_hz = flicker_filter.frequency_hz();
  return out;
}

TEST(FlickerFilter, TellsFlickerFromMovingEdges) {
  for (const double hz : {90.0, 100.0, 130.0})
    for (const double width : {0.3, 1.0})
      for (const double probability : {0.02, 0.1, 0.5}) {
        Stream stream = edges_and_noise(0.7);
        add_lamp(stream, {.hz = hz, .width = width, .probability = probability, .to_s = 0.7});
        const Result result = filter(std::move(stream));
        EXPECT_GT(result.flicker_removed, probability < 0.05 ? 0.8 : 0.9)
            << hz << ' ' << width << ' ' << probability;
        EXPECT_LT(result.own_removed, width == 1 && probability > 0.05 ? 0.35 : 0.2)
            << hz << ' ' << width << ' ' << probability;
        EXPECT_NEAR(result.frequency_hz, hz, 0.3);
      }
}

TEST(FlickerFilter, LeavesOutNearlyAllOfALampThatReachesEveryPixel) {
  Stream stream = edges_and_noise(0.8);
  add_lamp(stream, {.probability = 1, .to_s = 0.8});
  const Result result = filter(std::move(stream));
  EXPECT_GT(result.flicker_removed, 0.995);
  EXPECT_LT(result.own_removed, 0.4);
}

// An incandescent lamp's light grows and fades over the whole period, and each pixel fires more than once.
TEST(FlickerFilter, KnowsSoftFlicker) {
  Stream stream = edges_and_noise(1.2);
  for (int k = 0; k < 3; ++k)
    add_lamp(stream, {.hz = 100, .probability = 0.3, .from_s = 0.0012 * k, .to_s = 1.2, .spread = 0.25});
  EXPECT_GT(filter(std::move(stream)).flicker_removed, 0.9);
}

TEST(FlickerFilter, FollowsADriftingFrequency) {
  Stream stream = edges_and_noise(3);
  add_lamp(stream, {.hz = 100, .probability = 0.1, .to_s = 3, .drift_hz = 0.4});
  const Result result = filter(std::move(stream));
  EXPECT_GT(result.flicker_removed, 0.9);
  EXPECT_LT(result.own_removed, 0.25);
}

TEST(FlickerFilter, WorksOnALargeSensor) {
  const Size size{1280, 720};
  Stream stream;
  add_edges(stream, 0.5, size);
  add_lamp(stream, {.hz = 120, .width = 0.5, .probability = 0.03, .to_s = 0.5}, size);
  const Result result = filter(std::move(stream), size);
  EXPECT_GT(result.flicker_removed, 0.85);
  EXPECT_LT(result.own_removed, 0.2);
}

TEST(FlickerFilter, LeavesAllWhereNothingFlickers) {
  EXPECT_TRUE(filter({}).removed.empty());
  EXPECT_TRUE(filter(edges_and_noise(3)).removed.empty());
  Stream noise;
  add_noise(noise, 1, 2e6);
  EXPECT_TRUE(filter(std::move(noise)).removed.empty());
}

TEST(FlickerFilter, LeavesPulsesThatAreNotPeriodic) {
  for (const double probability : {0.05, 0.5}) {
    Stream stream = edges_and_noise(3);
    add_lamp(stream, {.hz = 100, .probability = probability, .to_s = 3, .irregular = 0.6});
    EXPECT_TRUE(filter(std::move(stream)).removed.empty());
  }
}

TEST(FlickerFilter, LeavesPeriodicLightOfOtherFrequencies) {
  for (const double hz : {30.0, 50.0, 150.0, 200.0}) {
    Stream stream = edges_and_noise(1);
    add_lamp(stream, {.hz = hz, .probability = 0.1, .to_s = 1});
    EXPECT_TRUE(filter(std::move(stream)).removed.empty()) << hz;
  }
}

TEST(FlickerFilter, LeavesASmallLampAndEdgesUnderAWeakOne) {
  Stream small = edges_and_noise(1);
  add_lamp(small, {.hz = 110, .probability = 1, .to_s = 1, .radius_px = 14});
  EXPECT_TRUE(filter(std::move(small)).removed.empty());
  Stream weak;
  add_edges(weak, 2, {}, 100);
  add_noise(weak, 2, 5000);
  EXPECT_TRUE(filter(std::move(weak)).removed.empty());
}

TEST(FlickerFilter, BeginsAndEndsWithTheLamp) {
  Stream stream = edges_and_noise(3);
  add_lamp(stream, {.probability = 0.2, .from_s = 1, .to_s = 2});
  const Result result = filter(std::move(stream));
  EXPECT_GT(result.flicker_removed, 0.75);
  ASSERT_FALSE(result.removed.empty());
  EXPECT_LT(result.removed.front().t, from_seconds(1.2));
  EXPECT_GE(result.removed.front().t, from_seconds(1));
  EXPECT_LT(result.removed.back().t, from_seconds(2.35));
}

TEST(FlickerFilter, OdometryCountsFlickerAndDoesNotDependOnPackets) {
  const Rig rig = test::davis_rig();
  SimulatedRecording data = test::record(rig, 1.2);
  Stream lamp;
  add_lamp(lamp, {.probability = 0.1, .from_s = 0.01, .to_s = seconds_between(0, data.events.back().t)});
  for (const Made& made : lamp) data.events.push_back(made.event);
  std::stable_sort(data.events.begin(), data.events.end(),
                   [](const Event& a, const Event& b) { return a.t < b.t; });
  std::vector<std::pair<std::int64_t, Vec3>> results;
  for (const std::size_t chunk : {std::size_t{977}, data.events.size()}) {
    Odometry odometry(rig, preset("realtime"));
    Vec3 last = Vec3::Zero();
    std::int64_t counted = 0;
    odometry.on_estimate([&](const Estimate& e) {
      last = e.state.T_w_i.p;
      counted += e.counts.flicker;
    });
    test::feed(odometry, data, chunk);
    const SegmenterCounts counts = odometry.event_counts();
    EXPECT_GT(counts.flicker, std::ssize(lamp) * 9 / 10);
    EXPECT_LE(counts.events, std::ssize(data.events));
    const auto warnings = odometry.diagnostics();
    ASSERT_EQ(warnings.entries().count("flicker"), 1U);
    test::expect_says(warnings.entries().at("flicker").first_message,
                      {"the light flickers at 100 Hz: ", " % of the events were left out"});
    results.emplace_back(counted, last);
  }
  EXPECT_EQ(results[0], results[1]);
}

TEST(FlickerFilter, CanBeSwitchedOff) {
  Options options = preset("realtime");
  options.filter.flicker = false;
  SimulatedRecording data = test::record(test::davis_rig(), 0.4);
  Stream lamp;
  add_lamp(lamp, {.probability = 0.1, .to_s = 0.4});
  data.events.clear();
  for (const Made& made : lamp) data.events.push_back(made.event);
  std::stable_sort(data.events.begin(), data.events.end(),
                   [](const Event& a, const Event& b) { return a.t < b.t; });
  Odometry odometry(test::davis_rig(), options);
  test::feed(odometry, data, data.events.size());
  EXPECT_EQ(odometry.event_counts().flicker, 0);
}

}  // namespace
}  // namespace idol
