#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/curves.hpp"
#include "idol/report/event_log.hpp"
#include "idol/report/page_json.hpp"
#include "idol/report/report.hpp"
#include "idol/report/run_folder.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;
using test::TempDir;

constexpr double kPi = 3.14159265358979323846;
constexpr Time kStart = 1'700'000'000'000'000'000;

/// A circle of radius 1 m at 1 rad/s, camera first, sampled every `interval_s`.
Trajectory circle(double seconds, double interval_s) {
  Trajectory out;
  for (int i = 0; i < std::lround(seconds / interval_s); ++i) {
    const double s = interval_s * i;
    out.push_back({kStart + from_seconds(s), {quat_exp({0, 0, s}), {std::cos(s), std::sin(s), 0.1 * s}}});
  }
  return out;
}

Trajectory moved(const Pose& T, Trajectory trajectory) {
  for (StampedPose& pose : trajectory) pose.T = T * pose.T;
  return trajectory;
}

/// The JSON inside a report, which must be the whole content of its <script> element.
Json data_of(const fs::path& page) {
  std::ifstream in(page, std::ios::binary);
  const std::string html(std::istreambuf_iterator<char>(in), {});
  const std::string open = "<script type=\"application/json\" id=\"run-data\">";
  const std::size_t begin = html.find(open) + open.size();
  return Json::parse(html.substr(begin, html.find("</script>", begin) - begin));
}

Json report_of(const TempDir& dir) {
  write_report(dir.path());
  return data_of(dir.path() / "report.html");
}

const Json* find_panel(const Json& data, const std::string& title) {
  for (const Json& panel : data["panels"])
    if (panel["title"] == title) return &panel;
  return nullptr;
}

std::string all_notes(const Json& data) {
  std::string text;
  for (const Json& note : data["notes"]) text += note.get<std::string>() + "\n";
  return text;
}

/// A small but whole run whose estimate is ground truth seen from a turned and shifted world.
void write_run(const TempDir& dir) {
  const Pose T_i_c{quat_exp({0.1, 0, 0}), {0.05, 0, 0}};
  const Pose T_world{quat_exp({0, 0, 0.8}), {3, -2, 1}};
  const Trajectory truth = circle(4, 0.005);
  const Trajectory camera = moved(T_world, circle(4, 0.05));
  Trajectory imu = camera;
  std::vector<NavState> states;
  for (StampedPose& pose : imu) {
    pose.T = pose.T * T_i_c.inverse();
    states.push_back({pose.t, pose.T, Vec3(1, 2, 3), {Vec3(0.01, 0, 0), Vec3(0, 0.2, 0)}});
  }
  write_trajectory(dir.path() / "trajectory_camera.txt", camera);
  write_trajectory(dir.path() / "trajectory_camera_causal.txt", camera);
  write_trajectory(dir.path() / "trajectory_imu.txt", imu);
  write_trajectory(dir.path() / "groundtruth_camera.txt", truth);
  write_states(dir.path() / "states.csv", states);
  write_states(dir.path() / "states_causal.csv", states);
  const std::vector<Line> lines = {
      {11, {0, 0, 0}, {1, 0, 0}, kStart, kStart + from_seconds(0.5), 10, 1000},
      {12, {0, 1, 0}, {0, 2, 0.5}, kStart + from_seconds(1), kStart + from_seconds(1), 1, 30}};
  write_lines_csv(dir.path() / "lines.csv", lines);
  std::string windows =
      "t,duration_s,events,in_segments,segments,lines,rms_px,mean_track_s,solve_s,sigma_px,sigma_py,sigma_pz,"
      "sigma_rx,sigma_ry,sigma_rz\n";
  for (std::size_t i = 0; i < states.size(); ++i)
    windows += fmt::format("{},0.05,2000,1500,12,10,{},0.1,0.02,0.01,0.02,0.03,0.001,0.002,0.003\n",
                           format_stamp(states[i].t), i == 1 ? "nan" : "0.7");
  dir.write("windows.csv", windows);
  Rig rig;
  rig.camera = {240, 180, 200, 200, 120, 90, Distortion::kNone, {}};
  rig.T_i_c = T_i_c;
  dir.write("rig_refined.yaml", rig_to_yaml(rig));
  dir.write("config.yaml", "window_s: 0.05\n");
  dir.write("stats.json", R"({"sequence": "a/circle", "preset": "paper", "version": "0.1.0", "duration_s": 4,
    "stages": {"solve": 1.5}, "warnings": {"imu_gap": {"message": "gap </script><!-- <script> here", "count": 2}}})");
  EventLog log(240, 180);
  const std::vector<PictureEvent> events = {{{10, 20}, 7, true}, {{30, 40}, kNoLine, false}};
  for (int i = 0; i < 3; ++i) log.add(kStart + from_seconds(0.05 * i), 2000, events);
  log.write(dir.path() / "events_shown.bin");
}

TEST(Report, HoldsTheRun) {
  const TempDir dir;
  write_run(dir);
  const Json data = report_of(dir);
  EXPECT_EQ(data["zero"], "1700000000.000000000");
  EXPECT_EQ(data["stats"]["preset"], "paper");
  EXPECT_EQ(data["smoothed"]["t"].size(), 80U);
  EXPECT_EQ(data["smoothed"]["p"].size(), 240U);
  EXPECT_EQ(data["smoothed"]["q"].size(), 320U);
  EXPECT_EQ(data["lines"]["id"], Json::parse("[11, 12]"));
  EXPECT_EQ(data["lines"]["b"], Json::parse("[1.0, 0.0, 0.0, 0.0, 2.0, 0.5]"));
  EXPECT_EQ(data["lines"]["first"][1], 1.0);
  EXPECT_EQ(data["trackLengths"]["counts"].front(), 1);
  EXPECT_EQ(data["trackLengths"]["counts"].back(), 1);
  EXPECT_EQ(data["files"][0]["text"], "window_s: 0.05\n");
  EXPECT_EQ(data["events"]["t"], Json::parse("[0.0, 0.05, 0.1]"));
  EXPECT_EQ(data["events"]["shown"], Json::parse("[2, 2, 2]"));
  const Json* rms = find_panel(data, "Distance of events to their lines, RMS");
  ASSERT_NE(rms, nullptr);
  EXPECT_EQ((*rms)["series"][0]["y"][0], 0.7);
  EXPECT_TRUE((*rms)["series"][0]["y"][1].is_null()) << "NaN is a gap";
}

TEST(Report, ComparesWithGroundTruthInTheWorldOfTheEstimate) {
  const TempDir dir;
  write_run(dir);
  const Json data = report_of(dir);
  ASSERT_EQ(data["evaluations"].size(), 2U);
  EXPECT_LT(data["evaluations"][0]["data"]["protocols"]["full"]["translation_m"]["rmse"].get<double>(), 1e-6);
  EXPECT_NEAR(data["truth"]["p"][0].get<double>(), data["smoothed"]["p"][0].get<double>(), 1e-5);
  for (const char* title : {"Position", "Orientation"}) {
    const Json& series = (*find_panel(data, title))["series"];
    ASSERT_EQ(series.size(), 9U) << title << ": smoothed, causal, truth";
    for (int axis = 0; axis < 3; ++axis) {
      // Every tenth ground-truth pose is an estimate's.
      EXPECT_NEAR(series[axis]["y"][30].get<double>(), series[axis + 6]["y"][300].get<double>(), 1e-3)
          << title;
      EXPECT_EQ(series[axis + 3]["style"], "causal");
      EXPECT_EQ(series[axis + 3]["band"].size(), 80U);
    }
  }
  EXPECT_NEAR((*find_panel(data, "Position"))["series"][4]["band"][0].get<double>(), 0.06, 1e-9);
  // The IMU sits 5 cm from the camera along its x axis: the radius of its circle is 0.95 m, its speed too.
  const Json& velocity = (*find_panel(data, "Velocity"))["series"];
  ASSERT_EQ(velocity.size(), 9U);
  const auto at = [&](int i) { return velocity[i + 3]["y"][300].get<double>(); };
  EXPECT_NEAR(std::hypot(at(3), at(4)), 0.95, 2e-3);
  EXPECT_NEAR(at(5), 0.1, 1e-4);
}

TEST(Report, ErrorsByAxisLieInBandsOfTheEstimator) {
  const TempDir dir;
  write_run(dir);
  const Json data = report_of(dir);
  for (const char* title : {"Causal position error by axis", "Causal rotation error by axis of the IMU"}) {
    const Json* panel = find_panel(data, title);
    ASSERT_NE(panel, nullptr) << title;
    for (const Json& s : (*panel)["series"]) {
      ASSERT_EQ(s["band"].size(), s["y"].size());
      for (const Json& y : s["y"]) EXPECT_LT(std::abs(y.get<double>()), 1e-4) << title;
    }
  }
  // The states claim a velocity that the circle does not have.
  EXPECT_GT(
      std::abs((*find_panel(data, "Causal velocity error by axis"))["series"][2]["y"][40].get<double>()), 2);
}

TEST(Report, BoxesOfTheSegments) {
  const TempDir dir;
  write_run(dir);
  const Json boxes = report_of(dir)["evaluations"][0]["boxes"];
  ASSERT_EQ(boxes.size(), 5U);
  EXPECT_EQ(boxes[0]["percent"], 10);
  for (const Json& box : boxes) {
    const auto five = box["translation_percent"].get<std::vector<double>>();
    ASSERT_EQ(five.size(), 5U);
    EXPECT_TRUE(std::is_sorted(five.begin(), five.end()));
    EXPECT_LT(five.back(), 0.01);
  }
}

TEST(Report, NothingInAFileCanBreakOutOfTheData) {
  const TempDir dir;
  write_run(dir);
  dir.write("rig.yaml", "# </script><script>alert(1)</script> \xff\xfe\n");
  const Json data = report_of(dir);
  EXPECT_EQ(data["stats"]["warnings"]["imu_gap"]["message"], "gap </script><!-- <script> here");
  std::ifstream in(dir.path() / "report.html", std::ios::binary);
  const std::string html(std::istreambuf_iterator<char>(in), {});
  EXPECT_EQ(html.find("alert(1)</script>"), std::string::npos);
  EXPECT_EQ(html.find("gap <"), std::string::npos);
  EXPECT_NE(html.find("default-src 'none'"), std::string::npos) << "nothing is fetched from anywhere";
  for (const char* way : {" src=\"", "href=\"http", "url(http", "@import", "<link rel=\"stylesheet"})
    EXPECT_EQ(html.find(way), std::string::npos) << way;
  EXPECT_EQ(html.find('@' + std::string("IDOL")), std::string::npos);
}

TEST(Report, WhatIsMissingOrDamagedIsANote) {
  const TempDir dir;
  dir.write("stats.json", "{}");
  EXPECT_NE(all_notes(report_of(dir)).find("trajectory_camera.txt is not there"), std::string::npos);
  dir.write("stats.json", "[1, 2");
  dir.write("trajectory_camera.txt", "1.0 nonsense\n");
  dir.write("lines.csv", "");
  dir.write("windows.csv", "t,events\n1.0,5,7\n");
  dir.write("groundtruth_camera.txt", "5 0 0 0 0 0 0 1\n");
  dir.write("evaluation.json", "no");
  dir.write("rig.yaml", "cam0: [");
  dir.write("events_shown.bin", "IDOLEV1\nhalf a window");
  const Json data = report_of(dir);
  const std::string notes = all_notes(data);
  for (const char* file : {"stats.json", "trajectory_camera.txt:1", "windows.csv:2", "evaluation.json",
                           "rig.yaml", "events_shown.bin"})
    EXPECT_NE(notes.find(file), std::string::npos) << file << " in\n" << notes;
  EXPECT_TRUE(data["stats"].is_null());
  EXPECT_TRUE(data["panels"].empty());
  EXPECT_TRUE(data["events"]["t"].empty());
}

TEST(Report, EvaluationFileIsShownInsteadOfItsOwn) {
  const TempDir dir;
  write_run(dir);
  dir.write("evaluation.json", R"({"matched": 3, "protocols": {"full": {"mpe_percent": 1.25}}})");
  const Json data = report_of(dir);
  ASSERT_EQ(data["evaluations"].size(), 2U);  // and the causal one, computed
  EXPECT_EQ(data["evaluations"][0]["data"]["protocols"]["full"]["mpe_percent"], 1.25);
}

TEST(Report, LongRunsStayLightAndSaySo) {
  const TempDir dir;
  const Trajectory camera = circle(60, 0.001);
  write_trajectory(dir.path() / "trajectory_camera.txt", camera);
  write_trajectory(dir.path() / "trajectory_camera_causal.txt", camera);
  write_trajectory(dir.path() / "groundtruth_camera.txt", camera);
  const Json data = report_of(dir);
  EXPECT_LE(data["smoothed"]["t"].size(), 4001U);
  EXPECT_DOUBLE_EQ(data["smoothed"]["t"].back().get<double>(), 59.999) << "the end is kept";
  EXPECT_NE(all_notes(data).find("one in 15 of the 60000 poses"), std::string::npos);
  EXPECT_LT(fs::file_size(dir.path() / "report.html"), 4U << 20);
}

TEST(Report, SameRunSamePage) {
  const TempDir dir;
  write_run(dir);
  const auto page = [&] {
    write_report(dir.path());
    return read_file(dir.path() / "report.html");
  };
  EXPECT_EQ(page(), page());
}

TEST(Report, CommandRefusesWhatIsNoRun) {
  const TempDir dir;
  const auto none = test::run_idol("report " + (dir.path() / "none").string());
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.err.find("no such folder"), std::string::npos) << none.err;
  dir.write("readme.txt", "hello");
  const auto other = test::run_idol("report " + dir.path().string());
  EXPECT_EQ(other.status, 1);
  EXPECT_NE(other.err.find("nothing of a run"), std::string::npos) << other.err;
  EXPECT_FALSE(fs::exists(dir.path() / "report.html"));
  EXPECT_EQ(test::run_idol("report").status, 2);
  write_run(dir);
  const auto good = test::run_idol("report " + dir.path().string());
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_EQ(data_of(dir.path() / "report.html")["stats"]["sequence"], "a/circle");
}

TEST(Curves, VelocityOfACircle) {
  const std::vector<Vec3> velocity = smoothed_velocity(circle(2, 0.005), 5);
  EXPECT_TRUE(std::isnan(velocity.front().x()));
  EXPECT_TRUE(std::isnan(velocity.back().x()));
  for (std::size_t i = 5; i + 5 < velocity.size(); ++i) {
    const double s = 0.005 * static_cast<double>(i);
    EXPECT_LT((velocity[i] - Vec3(-std::sin(s), std::cos(s), 0.1)).norm(), 3e-4);
  }
  EXPECT_TRUE(smoothed_velocity({}, 5).empty());
}

TEST(Curves, ThinningKeepsExtremesAndGaps) {
  Series series{"a", 0, "", {}, {}, {}};
  for (int i = 0; i < 10000; ++i) {
    series.t.push_back(i);
    series.y.push_back(i == 4321 ? 50 : i == 8765 ? -50 : std::sin(0.001 * i));
  }
  for (int i = 2000; i < 3000; ++i)
    series.y[static_cast<std::size_t>(i)] = std::numeric_limits<double>::quiet_NaN();
  const Series thinned = thin(series, 100);
  EXPECT_LE(thinned.t.size(), 200U);
  EXPECT_TRUE(std::is_sorted(thinned.t.begin(), thinned.t.end()));
  double low = 0, high = 0;
  int gaps = 0;
  for (double y : thinned.y) {
    if (std::isnan(y)) ++gaps;
    low = std::fmin(low, y);
    high = std::fmax(high, y);
  }
  EXPECT_EQ(high, 50);
  EXPECT_EQ(low, -50);
  EXPECT_GE(gaps, 10);
  EXPECT_EQ(thin(thinned, 100).y.size(), thinned.y.size());
}

TEST(Curves, AnglesOfAFullTurnDoNotJump) {
  RunFolder run;
  for (int i = 0; i <= 100; ++i) {
    NavState s;
    s.t = from_seconds(0.1 * i);
    s.T_w_i.q = quat_exp({0, 0, 4 * kPi * i / 100});
    run.states.push_back(s);
  }
  const std::vector<Panel> panels = make_panels(run, {}, {}, 0);
  ASSERT_GE(panels.size(), 2U);
  const Series& yaw = panels[1].series[2];
  EXPECT_NEAR(yaw.y.back() - yaw.y.front(), 720, 1e-6);
}

TEST(PageJson, Base64OfRfc4648) {
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foob"), "Zm9vYg==");
  EXPECT_EQ(base64("\xff\xfe"), "//4=");
}

}  // namespace
}  // namespace idol
