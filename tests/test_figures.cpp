#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <regex>
#include <string>

#include "eval_util.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/event_log.hpp"
#include "idol/report/figures.hpp"
#include "idol/report/plot_marks.hpp"
#include "idol/report/run_folder.hpp"
#include "idol/report/ticks.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

/// A run folder that has all that figures draw from; the estimate is off by centimetres.
void write_drawable_run(const TempDir& dir) {
  const Trajectory truth = wavy_walk(400, 0.01);
  const Pose T_i_c{quat_exp({0.1, 0, 0}), {0.05, 0, 0}};
  Trajectory camera, imu;
  std::vector<NavState> states;
  std::string windows =
      "t,duration_s,events,segments,lines,rms_px,mean_track_s,solve_s,sigma_px,sigma_py,sigma_pz,sigma_rx,"
      "sigma_ry,"
      "sigma_rz,sigma_vx,sigma_vy,sigma_vz,sigma_bgx,sigma_bgy,sigma_bgz,sigma_bax,sigma_bay,sigma_baz,"
      "latency_s\n";
  for (std::size_t i = 0; i < truth.size(); i += 5) {
    StampedPose pose = truth[i];
    pose.T.p += 0.02 * Vec3(std::sin(0.1 * static_cast<double>(i)), 0, 1);
    camera.push_back(pose);
    imu.push_back({pose.t, pose.T * T_i_c.inverse()});
    states.push_back({pose.t, imu.back().T, Vec3(1, 2, 3), {Vec3(0.01, 0, 0), Vec3(0, 0.2, 0)}});
    windows += fmt::format("{},0.05,20000,12,10,0.7,0.4,0.01", format_stamp(pose.t));
    for (int k = 0; k < 15; ++k) windows += ",0.01";
    windows += ",0.004\n";
  }
  for (const char* which : {"", "_causal"}) {
    write_trajectory(dir.path() / fmt::format("trajectory_camera{}.txt", which), camera);
    write_trajectory(dir.path() / fmt::format("trajectory_imu{}.txt", which), imu);
  }
  write_trajectory(dir.path() / "groundtruth_camera.txt", truth);
  write_states(dir.path() / "states.csv", states);
  write_states(dir.path() / "states_causal.csv", states);
  write_lines_csv(dir.path() / "lines.csv", std::vector<Line>{{11, {0, 0, 0}, {1, 0, 0}, 0, 1, 10, 1000},
                                                              {12, {0, 1, 0}, {0, 2, 0.5}, 1, 1, 1, 30}});
  dir.write("windows.csv", windows);
  Rig rig;
  rig.camera = {240, 180, 200, 200, 120, 90, Distortion::kNone, {}};
  rig.T_i_c = T_i_c;
  dir.write("rig_refined.yaml", rig_to_yaml(rig));
  dir.write("rig.yaml",
            "cam0:\n  T_cam_imu: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n  camera_model: pinhole\n"
            "  distortion_coeffs: [0,0,0,0]\n  distortion_model: radtan\n  intrinsics: [200,200,120,90]\n"
            "  resolution: [240,180]\n  timeshift_cam_imu: 0\n");
  EventLog log(240, 180);
  log.add(truth[100].t, 2, std::vector<PictureEvent>{{{10, 20}, 11, true}, {{30, 40}, kNoLine, false}});
  log.write(dir.path() / "events_shown.bin");
}

std::size_t page_count(const std::string& pdf) {
  const std::regex page("/Type /Page[^s]");
  return static_cast<std::size_t>(
      std::distance(std::sregex_iterator(pdf.begin(), pdf.end(), page), std::sregex_iterator()));
}

/// Width and height in a PNG's header.
std::pair<int, int> png_size(const std::string& png) {
  const auto number = [&](std::size_t at) {
    int value = 0;
    for (std::size_t i = at; i < at + 4; ++i) value = value << 8 | static_cast<unsigned char>(png[i]);
    return value;
  };
  EXPECT_EQ(png.substr(0, 4), "\x89PNG");
  return {number(16), number(20)};
}

TEST(Ticks, ReadWell) {
  EXPECT_EQ(make_ticks(0, 1, 5).at.size(), 6U);
  EXPECT_DOUBLE_EQ(make_ticks(0, 1, 5).step, 0.2);
  EXPECT_DOUBLE_EQ(make_ticks(-3.2e-5, 4e-5, 4).step, 2e-5);
  EXPECT_DOUBLE_EQ(make_ticks(0, 97, 10).step, 10);
  const Ticks tenths = make_ticks(-0.31, 0.3, 6);
  EXPECT_EQ(tenths.at.size(), 7U) << "an end that is a multiple belongs to it, whatever its rounding";
  EXPECT_EQ(tenths.label(tenths.at[3]), "0.0");
  EXPECT_EQ(tenths.label(-0.1), "\u22120.1");
  EXPECT_EQ(make_ticks(0, 400, 4).label(200), "200");
  EXPECT_EQ(make_ticks(0, 0.08, 4).label(0.04), "0.04");
}

TEST(PlotMarks, BoxesShowPercentiles) {
  std::vector<double> values;
  for (int i = 100; i >= 0; --i) values.push_back(i);
  const BoxFigures f = box_figures(values);
  EXPECT_DOUBLE_EQ(f.low, 5);
  EXPECT_DOUBLE_EQ(f.first, 25);
  EXPECT_DOUBLE_EQ(f.median, 50);
  EXPECT_DOUBLE_EQ(f.third, 75);
  EXPECT_DOUBLE_EQ(f.high, 95);
  EXPECT_DOUBLE_EQ(box_figures({2}).median, 2);
  EXPECT_DOUBLE_EQ(finite_quantile({std::nan(""), 1, 3}, 0.5), 2);
  EXPECT_TRUE(std::isnan(finite_quantile({}, 0.5)));
}

TEST(Figures, AllOfThemAreThePagesOfOnePdf) {
  const TempDir dir;
  write_drawable_run(dir);
  const FigureFiles files = write_figures(dir.path(), dir.path() / "figures.pdf", {});
  EXPECT_TRUE(files.left_out.empty()) << files.left_out.front();
  const std::string pdf = read_file(dir.path() / "figures.pdf");
  EXPECT_TRUE(pdf.starts_with("%PDF"));
  EXPECT_EQ(page_count(pdf), figure_names().size());
  EXPECT_EQ(pdf.find("CreationDate"), std::string::npos);
  write_figures(dir.path(), dir.path() / "again.pdf", {});
  EXPECT_EQ(read_file(dir.path() / "again.pdf"), pdf) << "the same run gives the same bytes";
}

TEST(Figures, TextInAPdfIsText) {
  if (std::system("command -v pdftotext >/dev/null") != 0) GTEST_SKIP() << "pdftotext is not on this machine";
  const TempDir dir;
  write_drawable_run(dir);
  write_figures(dir.path(), dir.path() / "figures.pdf", {});
  ASSERT_EQ(std::system(("cd " + dir.path().string() + " && pdftotext figures.pdf figures.txt").c_str()), 0);
  expect_says(read_file(dir.path() / "figures.txt"),
              {"time [s]", "ground truth", "smoothed", "causal", "roll [deg]", "gyroscope [deg/s]",
               "translation [mm]", "latency [ms]", "3\u03c3"});
}

TEST(Figures, OneFitsAColumn) {
  const TempDir dir;
  write_drawable_run(dir);
  const auto width_of = [&](const FigureOptions& options) {
    write_figures(dir.path(), dir.path() / "one.png", options);
    return png_size(read_file(dir.path() / "one.png")).first;
  };
  EXPECT_EQ(width_of({FigureFormat::kPng, {"errors"}, 0, 254}), 880);
  EXPECT_EQ(width_of({FigureFormat::kPng, {"errors"}, 60, 254}), 600);
  EXPECT_EQ(width_of({FigureFormat::kPng, {"errors"}, 60, 127}), 300);
  const FigureFiles svg =
      write_figures(dir.path(), dir.path() / "two.svg", {FigureFormat::kSvg, {"map", "bias"}});
  EXPECT_EQ(svg.written, (std::vector<fs::path>{dir.path() / "two_map.svg", dir.path() / "two_bias.svg"}));
  EXPECT_NE(read_file(svg.written[1]).find("<svg"), std::string::npos);
}

TEST(Figures, WithoutTheirDataTheyAreLeftOut) {
  const TempDir dir;
  write_drawable_run(dir);
  for (const char* file : {"groundtruth_camera.txt", "lines.csv", "rig.yaml"}) fs::remove(dir.path() / file);
  const FigureFiles files = write_figures(dir.path(), dir.path() / "f.pdf", {});
  ASSERT_EQ(files.left_out.size(), 5U);
  expect_says(files.left_out[0], {"'errors'", "groundtruth_camera.txt"});
  EXPECT_EQ(page_count(read_file(dir.path() / "f.pdf")), figure_names().size() - 5);
  for (const FigureName& figure : figure_names()) {
    const TempDir bare;
    bare.write("stats.json", "{}");
    try {
      write_figures(bare.path(), bare.path() / "f.pdf", {FigureFormat::kPdf, {figure.name}});
      ADD_FAILURE() << figure.name;
    } catch (const DataError& e) {
      expect_says(e.what(), {figure.name, "needs"});
    }
    EXPECT_FALSE(fs::exists(bare.path() / "f.pdf"));
  }
}

TEST(Figures, DegenerateRunsCrashNothing) {
  const TempDir dir;
  write_drawable_run(dir);
  const Trajectory still(3, pose_at(1, {1, 1, 1}));
  Trajectory poses = still;
  for (std::size_t i = 0; i < poses.size(); ++i) poses[i].t += static_cast<Time>(i);
  for (const char* file : {"trajectory_camera.txt", "trajectory_camera_causal.txt", "groundtruth_camera.txt"})
    write_trajectory(dir.path() / file, poses);
  dir.write("windows.csv", "t,events,duration_s,solve_s,lines\n1.0,0,0,nan,nan\n");
  std::string events = read_file(dir.path() / "events_shown.bin");
  events[28] = '\x7f';  // groups that do not follow
  dir.write("events_shown.bin", events);
  EXPECT_THROW(write_figures(dir.path(), dir.path() / "f.pdf", {FigureFormat::kPdf, {"events"}}), DataError);
  EXPECT_GE(write_figures(dir.path(), dir.path() / "f.pdf", {}).written.size(), 1U);
}

TEST(Figures, CommandTellsWhatIsWrong) {
  const TempDir dir;
  write_drawable_run(dir);
  const std::string run = "report " + dir.path().string();
  const CommandResult unknown =
      run_idol(run + " --figure trajectories --pdf " + (dir.path() / "f.pdf").string());
  EXPECT_EQ(unknown.status, 2);
  expect_says(unknown.err, {"'trajectories' is not known", "trajectory, position"});
  EXPECT_EQ(run_idol(run + " --figure map").status, 2) << "no file to write to";
  EXPECT_EQ(run_idol(run + " --pdf f.pdf --width 3").status, 2);
  const CommandResult refused = run_idol(run + " --pdf " + (dir.path() / "none/f.pdf").string());
  EXPECT_EQ(refused.status, 1);
  fs::remove(dir.path() / "lines.csv");
  const CommandResult good = run_idol(run + " --pdf " + (dir.path() / "f.pdf").string());
  EXPECT_EQ(good.status, 0) << good.err;
  EXPECT_EQ(good.out, (dir.path() / "f.pdf").string() + "\n");
  EXPECT_EQ(good.err, "idol: figure 'map' is left out: it needs lines.csv with lines\n");
  for (const FigureName& figure : figure_names())
    EXPECT_NE(run_idol("report --help").out.find("  " + figure.name), std::string::npos) << figure.name;
}

}  // namespace
}  // namespace idol::test
