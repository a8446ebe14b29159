#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "idol/report/hints.hpp"

namespace idol {
namespace {

/// 10 s at 20 Hz with a given velocity, all of it well otherwise.
RunFolder run_moving(const std::function<Vec3(double)>& velocity) {
  RunFolder run;
  for (int i = 0; i <= 200; ++i) {
    const double t = 0.05 * i;
    NavState s;
    s.t = from_seconds(t);
    s.v_w = velocity(t);
    run.states.push_back(s);
    run.windows.t.push_back(s.t);
    const auto add = [&](const char* column, double value) { run.windows.columns[column].push_back(value); };
    add("events", 5000);
    add("lines_seen", 12);
    add("settled", 1);
    add("thinned", 0);
    add("hot", 0);
    add("restarts", 0);
    add("solve_s", 0.01);
    add("integrate_s", 0.001);
    add("segment_s", 0.01);
    add("duration_s", 0.05);
  }
  return run;
}

Vec3 swinging(double t) { return {std::sin(3 * t), 0.3, 0}; }

void set_column(RunFolder& run, const char* column, double from, double to, double value) {
  for (std::size_t i = 0; i < run.windows.t.size(); ++i)
    if (seconds_between(from_seconds(from), run.windows.t[i]) > 0 && run.windows.t[i] <= from_seconds(to))
      run.windows.columns[column][i] = value;
}

std::string hints_of(const RunFolder& run, const std::vector<Panel>& panels = {}) {
  std::string all;
  for (const std::string& hint : run_hints(run, panels, 0)) all += hint + "\n";
  return all;
}

TEST(Hints, AGoodRunHasNone) { EXPECT_EQ(hints_of(run_moving(swinging)), ""); }

TEST(Hints, ConstantVelocityLeavesTheScaleWeak) {
  const RunFolder run = run_moving([](double t) {
    return t < 3 ? swinging(t) : t < 6 ? swinging(3) : swinging(t - 3);
  });
  const std::string hints = hints_of(run);
  EXPECT_EQ(hints.find("Accelerometer hardly excited: scale is weak from 3."), 0U) << hints;
  EXPECT_EQ(hints_of(run_moving([](double) { return Vec3(0, 0, 0); })), "") << "rest is no trouble";
}

TEST(Hints, TurningInPlace) {
  RunFolder run = run_moving([](double) { return Vec3(0, 0, 0); });
  for (std::size_t i = 0; i < run.states.size(); ++i)
    run.states[i].T_w_i.q = quat_exp({0, 0, i < 100 ? 0.05 * static_cast<double>(i) : 5.0});
  EXPECT_EQ(hints_of(run), "Turning in place: new lines get no depth from 0.1 to 5.0 s.\n");
}

TEST(Hints, SpansOfWindows) {
  RunFolder run = run_moving(swinging);
  set_column(run, "lines_seen", 1, 2, 2);
  set_column(run, "lines_seen", 4, 4.5, 0);
  set_column(run, "lines_seen", 6, 6.1, 0);  // too short to matter
  set_column(run, "solve_s", 7, 8, 0.06);
  set_column(run, "settled", 0, 0.5, 0);
  set_column(run, "restarts", 8.99, 10, 1);
  set_column(run, "hot", 0, 10, 1000);
  set_column(run, "thinned", 2, 3, 2000);
  const std::string hints = hints_of(run);
  for (const char* hint : {"Few lines in sight: the IMU is nearly alone from 1.0 to 2.0 s, 4.0 to 4.5 s.",
                           "Slower than real time from 7.0 to 8.0 s.", "poses are rough from 0.0 to 0.5 s.",
                           "lost and began anew at 9.0 s", "20 % of the events come from hot pixels",
                           "left out many events to keep up from 2.0 to 3.0 s."})
    EXPECT_NE(hints.find(hint), std::string::npos) << hint << "\nnot in\n" << hints;
}

TEST(Hints, AtRestNoLinesAreMissed) {
  RunFolder run = run_moving([](double t) { return t < 5 ? Vec3(0, 0, 0) : swinging(t); });
  set_column(run, "lines_seen", 1, 3, 0);
  EXPECT_EQ(hints_of(run), "");
  set_column(run, "lines_seen", 6, 7, 0);
  EXPECT_EQ(hints_of(run), "Few lines in sight: the IMU is nearly alone from 6.0 to 7.0 s.\n");
}

TEST(Hints, TooMuchTrust) {
  const std::vector<double> t(100, 1.0), band(100, 0.1);
  std::vector<double> y(100, 0.05);
  const auto panels = [&] {
    return std::vector<Panel>{
        {"error", "Causal position error by axis", "m", {{"x", 0, "error", t, y, band}}}};
  };
  EXPECT_EQ(hints_of(run_moving(swinging), panels()), "");
  std::fill(y.begin(), y.begin() + 30, -0.2);
  EXPECT_NE(hints_of(run_moving(swinging), panels()).find("trusts its position too much: 30 %"),
            std::string::npos);
}

TEST(Hints, ManySpansAreCounted) {
  EXPECT_EQ(describe({{1, 2}, {3, 4.04}, {5, 6}, {7, 8}, {9, 10}}),
            "from 1.0 to 2.0 s, 3.0 to 4.0 s, 5.0 to 6.0 s and 2 more times");
  const std::vector<double> t = {0, 1, 2, 3, 4, 5};
  const std::vector<bool> holds = {false, true, false, true, false, false};
  EXPECT_EQ(spans_where(t, holds, 0, 0).size(), 2U);
  EXPECT_EQ(spans_where(t, holds, 1, 0), (Spans{{0, 3}}));
  EXPECT_TRUE(spans_where(t, holds, 0, 1.5).empty());
}

}  // namespace
}  // namespace idol
