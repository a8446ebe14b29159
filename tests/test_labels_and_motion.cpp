// What is made of labelled windows: delayed labels, whether the image moves, how wavy a segment is.
#include <cmath>
#include <numbers>

#include "idol/image/tracker/delayed_labels.hpp"
#include "idol/image/tracker/waviness.hpp"
#include "idol/odometry/image_motion.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

constexpr double kWindow = 0.05;  // [s]

EventWindow window_at(int k, std::size_t events = 0) {
  EventWindow window;
  window.begin = from_seconds(kWindow * k);
  window.end = from_seconds(kWindow * (k + 1));
  for (std::size_t i = 0; i < events; ++i)
    window.events.push_back({window.begin + static_cast<Time>(i), static_cast<std::uint16_t>(i), 5, true});
  return window;
}

// Four events: the first is of a known line, the middle ones are of a tentative one, the last is of none.
constexpr LineId kKnownLine = 1, kYoung = 7;
SegmentedWindow labelled(bool tentative) {
  SegmentedWindow out;
  out.ids = {kKnownLine, kNoLine, kNoLine, kNoLine};
  out.segments.push_back({kKnownLine, {0}, {}});
  if (tentative) out.candidates.push_back({kYoung, {1, 2}, {}});
  return out;
}

TEST(DelayedLabels, EventsOfAYoungLineGetTheIdThatItWillHave) {
  constexpr LineId kFinal = 3;
  DelayedLabels delayed;
  for (int k = 0; k < 2; ++k) {
    delayed.add(window_at(k, 4), labelled(true));
    EXPECT_FALSE(delayed.pop()) << "it may still turn out to be a line";
  }
  SegmentedWindow last = labelled(false);
  last.validated = {{kYoung, kFinal}};
  delayed.add(window_at(2, 4), last);
  for (int k = 0; k < 2; ++k) {
    const auto out = delayed.pop();
    ASSERT_TRUE(out);
    EXPECT_EQ(out->window.begin, from_seconds(kWindow * k));
    EXPECT_EQ(out->window.events.size(), 4U);
    EXPECT_EQ(out->segments.ids, (std::vector<LineId>{kKnownLine, kFinal, kFinal, kNoLine}));
    EXPECT_TRUE(out->segments.candidates.empty());
    ASSERT_EQ(out->segments.segments.size(), 2U);
    EXPECT_EQ(out->segments.segments[1].id, kFinal);
    EXPECT_EQ(out->segments.segments[1].events, (std::vector<std::uint32_t>{1, 2}));
  }
  EXPECT_TRUE(delayed.pop());
  EXPECT_FALSE(delayed.pop());
}

TEST(DelayedLabels, AnEventThatHasALineKeepsIt) {
  DelayedLabels delayed;
  SegmentedWindow first = labelled(true);
  first.ids[2] = kKnownLine;
  delayed.add(window_at(0, 4), first);
  SegmentedWindow second = labelled(false);
  second.validated = {{kYoung, kYoung}};
  delayed.add(window_at(1, 4), second);
  EXPECT_EQ(delayed.pop()->segments.ids, (std::vector<LineId>{kKnownLine, kYoung, kKnownLine, kNoLine}));
}

TEST(DelayedLabels, AWindowIsHeldNoLongerThanAsked) {
  constexpr int kHeld = 6;
  DelayedLabels delayed(kWindow * kHeld - 0.001);
  int next = 0;
  for (int k = 0; k < 40; ++k) {
    delayed.add(window_at(k, 4), labelled(true));
    while (const auto out = delayed.pop()) {
      EXPECT_EQ(out->window.begin, from_seconds(kWindow * next++));
      EXPECT_EQ(out->segments.ids[1], kNoLine);
    }
    EXPECT_EQ(next, std::max(0, k + 1 - kHeld));
  }
  // One that can change no more waits for those before it, and for no others.
  delayed.add(window_at(40, 4), labelled(false));
  int left = 0;
  while (const auto out = delayed.flush()) {
    EXPECT_EQ(out->window.begin, from_seconds(kWindow * next++));
    ++left;
  }
  EXPECT_EQ(next, 41);
  EXPECT_GE(left, kHeld);
  delayed.add(window_at(41, 4), labelled(false));
  EXPECT_TRUE(delayed.pop());
  EXPECT_FALSE(delayed.flush());
}

// Lines in all directions all over an image of 240 x 180, of which line k moves as the function says [px].
template <class Offset>
SegmentedWindow lines_in_view(int window, Offset offset) {
  constexpr int kLines = 20;
  SegmentedWindow out;
  for (int k = 0; k < kLines; ++k) {
    Segment s;
    s.id = k;
    const double angle = std::numbers::pi * k / kLines;
    s.line.direction = {std::cos(angle), std::sin(angle)};
    s.line.origin = Eigen::Vector2d(20 + 70 * (k % 4), 20 + 32 * (k / 4)) +
                    Eigen::Vector2d(offset(k, kWindow * (window + 0.5)), 0);
    s.line.time = kWindow / 2;
    s.line.u_min = -15, s.line.u_max = 15;
    out.segments.push_back(s);
  }
  return out;
}

template <class Offset>
int windows_that_move(Offset offset, int windows, double spread = 0) {
  ImageMotion motion(240, 180);
  int moving = 0;
  for (int k = 0; k < windows; ++k) {
    motion.add(window_at(k), lines_in_view(k, offset));
    moving += motion.moves(spread) ? 1 : 0;
  }
  return moving;
}

TEST(ImageMotion, ASlowPanMoves) {
  const auto pan = [](int, double t) { return 24 * t; };
  EXPECT_GE(windows_that_move(pan, 20), 16);
  EXPECT_GE(windows_that_move(pan, 20, 0.5), 16) << "all over the image";
}

TEST(ImageMotion, TremorAndAStillImageDoNot) {
  for (const double hz : {3.0, 8.0, 12.0})
    EXPECT_EQ(
        windows_that_move([&](int, double t) { return 0.7 * std::sin(2 * std::numbers::pi * hz * t); }, 60),
        0)
        << hz << " Hz";
  EXPECT_EQ(windows_that_move([](int, double) { return 0.0; }, 20), 0);
}

TEST(ImageMotion, OneMovingObjectDoesNot) {
  EXPECT_EQ(windows_that_move([](int k, double t) { return k >= 8 && k < 12 ? 24 * t : 0; }, 20), 0);
}

TEST(ImageMotion, APanThatStopsMovesNoMore) {
  const auto offset = [](int, double t) { return 24 * std::min(t, 1.0); };
  EXPECT_EQ(windows_that_move(offset, 60), windows_that_move(offset, 32));
}

TEST(ImageMotion, NothingSeenDoesNotMove) {
  ImageMotion motion(240, 180);
  EXPECT_FALSE(motion.moves());
  motion.add(window_at(0), {});
  EXPECT_FALSE(motion.moves());
}

// Mean square [px^2] over draws of a moving line that waves with so much amplitude.
double mean_square(double amplitude) {
  constexpr int kDraws = 200, kEvents = 120;
  constexpr double kScatter = 0.55, kLength = 80, kSpeed = 100, kTilt = 0.3;
  const UndistortMap undistort(240, 180);
  const Eigen::Vector2d across(std::cos(kTilt), std::sin(kTilt)), along(-across.y(), across.x());
  std::mt19937 rng(21);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal(0, kScatter);
  Waviness sum;
  for (int draw = 0; draw < kDraws; ++draw) {
    EventWindow window = window_at(0);
    std::vector<TimedPixel> points;
    std::vector<std::uint32_t> indices;
    const Eigen::Vector2d start(100 + unit(rng), 90 + unit(rng));
    for (int i = 0; i < kEvents; ++i) {
      const double t = kWindow * (i + 0.5) / kEvents, u = kLength * (unit(rng) - 0.5);
      const double wave = amplitude * std::sin(4 * std::numbers::pi * u / kLength);
      const Eigen::Vector2d p = start + u * along + (kSpeed * t + wave + normal(rng)) * across;
      const Event e{from_seconds(t), static_cast<std::uint16_t>(std::lround(p.x())),
                    static_cast<std::uint16_t>(std::lround(p.y())), true};
      indices.push_back(static_cast<std::uint32_t>(i));
      points.emplace_back(e.x, e.y, t);
      window.events.push_back(e);
    }
    const auto line = fit_moving_line(points, across, 2.5);
    if (!line) continue;
    const Waviness one = waviness(window, indices, *line, 2.5 * kScatter, undistort);
    sum.squares += one.squares, sum.events += one.events;
  }
  EXPECT_GT(sum.events, 0.7 * kDraws * kEvents);
  return sum.squares / sum.events;
}

TEST(Waviness, OfAStraightLineIsNothingOnAverage) { EXPECT_LT(std::abs(mean_square(0)), 0.02); }

// Less than the wave's own 0.125 px^2: pieces of a sixth of the line smooth it, and part of it counts as
// scatter.
TEST(Waviness, OfAWaveIsClearlyMore) {
  EXPECT_GT(mean_square(0.5), 0.02);
  EXPECT_GT(mean_square(1), 3 * mean_square(0.5));
}

TEST(Waviness, OfNoEventsIsNone) {
  EXPECT_EQ(waviness(window_at(0), {}, MovingLine{}, 1, UndistortMap(240, 180)).rms_px(), 0);
}

}  // namespace
}  // namespace idol::test
