// Which line claims an event: against a plain loop over all lines.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "idol/image/tracker/line_claims.hpp"

namespace idol {
namespace {

constexpr int kWidth = 120, kHeight = 90;
constexpr Time kMiddle = 2'000'000;

// Lines over the image, each with room for its counts.
struct Lines {
  std::vector<ClaimingLine> lines;
  std::vector<std::vector<float>> along;

  Lines(int count, std::mt19937& random) : along(static_cast<std::size_t>(count)) {
    std::uniform_real_distribution<float> share(0, 1);
    for (auto& counts : along) {
      ClaimingLine line;
      const float angle = 7 * share(random);
      line.id = static_cast<LineId>(lines.size()) + 10;
      line.cx = kWidth * share(random), line.cy = kHeight * share(random);
      line.dx = std::cos(angle), line.dy = std::sin(angle);
      line.half = 5 + 30 * share(random);
      line.rate = 400 * share(random) - 200, line.turn = share(random) - 0.5F;
      line.gate = 1.3F + 2 * share(random);
      line.expected = std::floor(3 * share(random)) - 1;
      line.along_at = -line.half - 2;
      counts.resize(static_cast<std::size_t>(2 * line.half) + 6);
      line.along = counts.data();
      lines.push_back(line);
    }
  }
};

std::vector<Event> random_events(std::size_t count, std::mt19937& random) {
  std::uniform_int_distribution<int> x(0, kWidth - 1), y(0, kHeight - 1), on(0, 1);
  std::vector<Event> events;
  for (std::size_t i = 0; i < count; ++i)
    events.push_back({static_cast<Time>(i * 4'000'000 / count), static_cast<std::uint16_t>(x(random)),
                      static_cast<std::uint16_t>(y(random)), on(random) == 1});
  return events;
}

// The line nearest in its own gates of those that reach to the event and fire with its polarity.
LineId nearest(const Event& e, const std::vector<ClaimingLine>& lines) {
  LineId id = kNoLine;
  double least = 1;
  for (const ClaimingLine& line : lines) {
    const double x = e.x - line.cx, y = e.y - line.cy, u = line.dx * x + line.dy * y;
    const double t = seconds_between(kMiddle, e.t);
    const double off = std::abs(line.dx * y - line.dy * x - (line.rate + line.turn * u) * t) / line.gate;
    const bool fits = line.expected == 0 || (line.expected > 0) == e.polarity;
    if (!fits || off >= least || std::abs(u) >= line.half + 1) continue;
    least = off;
    id = line.id;
  }
  return id;
}

std::size_t claim(LineClaims& claims, const std::vector<Event>& events, std::vector<ClaimingLine>& lines,
                  std::vector<LineId>& labels, const std::vector<std::uint8_t>& isolated) {
  labels.assign(events.size(), 0);
  return claims.claim(events, kMiddle, lines, isolated, 200, labels.data());
}

TEST(LineClaims, AreThoseOfThePlainLoop) {
  std::mt19937 random(1);
  const UndistortMap undistort(kWidth, kHeight);
  LineClaims claims(undistort);
  const std::vector<std::uint8_t> isolated(undistort.pixels());
  for (int round = 0; round < 50; ++round) {
    Lines lines(round % 4, random);  // a cell names no more than three
    const auto events = random_events(500 + static_cast<std::size_t>(round), random);
    std::vector<LineId> labels;
    EXPECT_EQ(claim(claims, events, lines.lines, labels, isolated), 0U);
    std::size_t without = 0;
    for (std::size_t i = 0; i < events.size(); ++i) {
      EXPECT_EQ(labels[i], nearest(events[i], lines.lines)) << i;
      if (labels[i] != kNoLine) continue;
      ASSERT_LT(without, claims.rest().size());
      EXPECT_EQ(claims.rest()[without++], i);
    }
    EXPECT_EQ(claims.rest().size(), without);
  }
}

TEST(LineClaims, AddUpWhatTheEventsSay) {
  std::mt19937 random(2);
  const UndistortMap undistort(kWidth, kHeight);
  LineClaims claims(undistort);
  const std::vector<std::uint8_t> isolated(undistort.pixels());
  for (int round = 0; round < 20; ++round) {
    Lines lines(1, random);
    const auto events = random_events(3000, random);
    std::vector<LineId> labels;
    claim(claims, events, lines.lines, labels, isolated);
    const ClaimingLine& line = lines.lines[0];
    double n = 0, sum_u = 0, sum_r = 0, sum_rr = 0;
    for (std::size_t i = 0; i < events.size(); ++i) {
      if (labels[i] == kNoLine) continue;
      const double x = events[i].x - line.cx, y = events[i].y - line.cy, u = line.dx * x + line.dy * y;
      const double r =
          line.dx * y - line.dy * x - (line.rate + line.turn * u) * seconds_between(kMiddle, events[i].t);
      ++n, sum_u += u, sum_r += r, sum_rr += r * r;
    }
    float counted = 0;
    for (const float count : lines.along[0]) counted += count;
    EXPECT_EQ(line.n, n);
    EXPECT_EQ(counted, n);
    EXPECT_NEAR(line.u, sum_u, 0.02);
    EXPECT_NEAR(line.r, sum_r, 0.01);
    EXPECT_NEAR(line.rr, sum_rr, 0.01);
    EXPECT_GE(line.core + line.left + line.right, n);
  }
}

TEST(LineClaims, LeaveOutHotPixels) {
  std::mt19937 random(3);
  const UndistortMap undistort(kWidth, kHeight);
  LineClaims claims(undistort);
  std::vector<std::uint8_t> isolated(undistort.pixels());
  Lines lines(2, random);
  const auto events = random_events(1000, random);
  isolated[static_cast<std::size_t>(events[7].y) * kWidth + events[7].x] = 200;
  std::vector<LineId> labels;
  EXPECT_GE(claim(claims, events, lines.lines, labels, isolated), 1U);
  EXPECT_EQ(labels[7], kNoLine);
  EXPECT_EQ(std::count(claims.rest().begin(), claims.rest().end(), 7U), 0);
}

// The stamps of cells begin again after 65535 batches: none may take an old line for one of its own.
TEST(LineClaims, ForgetTheLinesOfEarlierBatches) {
  std::mt19937 random(4);
  const UndistortMap undistort(kWidth, kHeight);
  LineClaims claims(undistort);
  const std::vector<std::uint8_t> isolated(undistort.pixels());
  Lines lines(3, random);
  const auto events = random_events(300, random);
  std::vector<LineId> labels;
  claim(claims, events, lines.lines, labels, isolated);
  EXPECT_LT(std::count(labels.begin(), labels.end(), kNoLine), 300);
  std::vector<ClaimingLine> none;
  const std::vector<Event> one(events.begin(), events.begin() + 1);
  for (int batch = 0; batch < 65534; ++batch) claim(claims, one, none, labels, isolated);
  for (int batch = 0; batch < 3; ++batch) {
    claim(claims, events, none, labels, isolated);
    EXPECT_EQ(std::count(labels.begin(), labels.end(), kNoLine), 300);
  }
}

}  // namespace
}  // namespace idol
