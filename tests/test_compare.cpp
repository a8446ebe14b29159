#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>

#include "eval_util.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/report/compared_runs.hpp"
#include "idol/report/comparison.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

/// A folder of a run with an RMSE [mm] of each trajectory.
fs::path write_compared_run(const TempDir& dir, const std::string& name, const std::string& sequence,
                            double smoothed_mm, double causal_mm, const std::string& config = "a: 1\n") {
  fs::create_directories(dir.path() / name);
  dir.write(name + "/stats.json",
            fmt::format(R"({{"sequence": "{}", "preset": "realtime", "status": "done", "realtime_factor": 2.5,
                         "peak_rss_mb": 100, "restarts": 0}})",
                        sequence));
  dir.write(name + "/config.yaml", config);
  for (const auto& [file, mm] :
       {std::pair{"evaluation", smoothed_mm}, std::pair{"evaluation_causal", causal_mm}})
    dir.write(fmt::format("{}/{}.json", name, file),
              fmt::format(R"({{"protocols": {{"full": {{"translation_m": {{"rmse": {}}}}}}}}})", 1e-3 * mm));
  return dir.path() / name;
}

double value_of(const Comparison& comparison, const std::string& group, const std::string& name,
                const std::string& key, bool change = false) {
  for (const FiguresRow& row : comparison.table.rows)
    for (std::size_t c = 0; c < row.cells.size(); ++c)
      if (row.group == group && row.name == name && comparison.table.columns[c].key == key)
        return change ? row.cells[c].change_percent : row.cells[c].value;
  ADD_FAILURE() << group << ", " << name << ", " << key << " is not in the table";
  return std::nan("");
}

/// Two configurations, `new` and `old`, on two recordings; one more of `new` alone.
struct CompareRuns : testing::Test {
  TempDir dir;
  void SetUp() override {
    write_compared_run(dir, "old/desk", "data/desk/", 4, 5);
    write_compared_run(dir, "old/room", "data/room.bag", 9, 20);
    write_compared_run(dir, "new/desk", "other/desk", 4.4, 5);
    write_compared_run(dir, "new/room", "data/room.bag", 4, 10);
    write_compared_run(dir, "new/hall", "data/hall.h5", 7, 7);
  }
  [[nodiscard]] std::vector<fs::path> both() const { return {dir.path() / "old", dir.path() / "new"}; }
};

TEST_F(CompareRuns, GroupsByRecordingAndAverages) {
  const Comparison c = compare_runs(both(), {});
  ASSERT_EQ(c.table.rows.size(), 7U);
  EXPECT_EQ(c.table.rows[0].group, "desk");
  EXPECT_EQ(c.table.rows[0].name, "old");
  EXPECT_TRUE(c.table.rows[0].cells[1].best);
  EXPECT_FALSE(c.table.rows[1].cells[1].best);
  EXPECT_FALSE(c.table.rows[0].cells[0].best) << "equal ones are not best";
  EXPECT_NEAR(value_of(c, "hall", "new", "full_rmse"), 7, 1e-12);
  EXPECT_NEAR(value_of(c, "geometric mean of 2", "old", "full_rmse"), 6, 1e-12) << "of the shared recordings";
  EXPECT_NEAR(value_of(c, "geometric mean of 2", "old", "causal_full_rmse"), 10, 1e-12);
  EXPECT_NEAR(value_of(c, "geometric mean of 2", "new", "full_rmse"), std::sqrt(17.6), 1e-12);
  EXPECT_TRUE(std::isnan(value_of(c, "geometric mean of 2", "new", "restarts")));
  EXPECT_TRUE(c.regressions.empty());
}

TEST_F(CompareRuns, BaselineIsAFolderOrAName) {
  ComparisonOptions options;
  options.baseline = "old";
  const Comparison by_name = compare_runs(both(), options);
  EXPECT_NEAR(value_of(by_name, "desk", "new", "full_rmse", true), 10, 1e-9);
  EXPECT_TRUE(std::isnan(value_of(by_name, "desk", "old", "full_rmse", true)));
  EXPECT_TRUE(std::isnan(value_of(by_name, "hall", "new", "full_rmse", true)));
  EXPECT_NEAR(value_of(by_name, "geometric mean of 2", "new", "full_rmse", true),
              100 * (std::sqrt(17.6) / 6 - 1), 1e-9);
  options.baseline = (dir.path() / "old").string();
  const Comparison by_folder = compare_runs({dir.path() / "new"}, options);
  EXPECT_EQ(table_as(TableFormat::kCsv, by_folder.table), table_as(TableFormat::kCsv, by_name.table));
  options.baseline = "older";
  EXPECT_THROW(compare_runs(both(), options), UsageError);
}

TEST_F(CompareRuns, RegressionsAreTold) {
  ComparisonOptions options;
  options.baseline = "old";
  options.fail_above = 10.5;
  EXPECT_TRUE(compare_runs(both(), options).regressions.empty());
  options.fail_above = 9.5;
  const auto worse = compare_runs(both(), options).regressions;
  ASSERT_EQ(worse.size(), 1U);
  EXPECT_EQ(worse[0], "desk, new: smoothed full RMSE mm 4.40 instead of 4.00, +10.0 %, more than 9.5 %");
  options.fail_above = 1000;
  fs::remove(dir.path() / "new/desk/evaluation_causal.json");
  dir.write("new/room/stats.json", R"({"sequence": "room", "status": "events.txt:7: damaged"})");
  const auto missing = compare_runs(both(), options).regressions;
  ASSERT_EQ(missing.size(), 2U) << "what cannot be compared any more is not well";
  expect_says(missing[0], {"desk, new: causal full RMSE mm is not there; it was 5.00"});
  EXPECT_EQ(missing[1], "room, new: events.txt:7: damaged");
  fs::remove_all(dir.path() / "new/room");
  EXPECT_EQ(compare_runs(both(), options).regressions.back(), "room: only the baseline has a run of it");
}

TEST_F(CompareRuns, CommandsExitStatusIsForCi) {
  const std::string old = (dir.path() / "old").string(), fresh = (dir.path() / "new").string();
  EXPECT_EQ(run_idol("compare " + fresh + " --baseline " + old + " --fail-above 11").status, 0);
  const CommandResult worse = run_idol("compare " + fresh + " --baseline " + old + " --fail-above 9");
  EXPECT_EQ(worse.status, 1);
  expect_says(worse.out, {"geometric mean of 2", "4.40   +10.0"});
  expect_says(worse.err, {"idol: worse: desk, new: smoothed full RMSE mm"});
  const CommandResult unknown = run_idol("compare " + old + " --figures full_rmse,speed");
  EXPECT_EQ(unknown.status, 2);
  expect_says(unknown.err, {"'speed' is not known", "causal_full_rmse"});
  EXPECT_EQ(run_idol("compare " + old + " --fail-above 9").status, 2) << "needs a baseline";
  EXPECT_EQ(run_idol("compare " + old + " --format word").status, 2);
  EXPECT_EQ(run_idol("compare").status, 2);
  const CommandResult none = run_idol("compare " + (dir.path() / "none").string());
  EXPECT_EQ(none.status, 1);
  expect_says(none.err, {"no such folder"});
  fs::create_directory(dir.path() / "empty");
  expect_says(run_idol("compare " + (dir.path() / "empty").string()).err, {"holds no run"});
}

TEST_F(CompareRuns, EveryFormatHasItsOwnManners) {
  const std::string run = "compare " + (dir.path() / "old").string() + " " + (dir.path() / "new").string() +
                          " --figures causal_full_rmse,restarts";
  EXPECT_EQ(run_idol(run + " --format csv").out,
            "recording,run,remark,causal_full_rmse,restarts\n"
            "desk,old,,5,0\ndesk,new,,5,0\nhall,new,,7,0\nroom,old,,20,0\nroom,new,,10,0\n"
            "geometric mean of 2,old,,10,\ngeometric mean of 2,new,,7.07106781,\n");
  EXPECT_EQ(run_idol(run + " --format markdown").out,
            "| recording | run | causal full: RMSE mm | restarts |\n|---|---|--:|--:|\n"
            "| desk | old | 5.00 | 0 |\n|  | new | 5.00 | 0 |\n| hall | new | 7.00 | 0 |\n"
            "| room | old | 20.00 | 0 |\n|  | new | **10.00** | 0 |\n"
            "| geometric mean of 2 | old | 10.00 | - |\n|  | new | **7.07** | - |\n");
  expect_says(run_idol(run + " --format latex").out,
              {"\\toprule", "\\midrule\nroom & old & 20.00 & 0 \\\\\n & new & \\textbf{10.00} & 0 \\\\",
               "\\bottomrule"});
  const fs::path page = dir.path() / "table.html";
  const CommandResult html = run_idol(run + " --out " + page.string());
  EXPECT_EQ(html.status, 0) << html.err;
  EXPECT_EQ(html.out, "");
  std::ifstream in(page);
  const std::string text(std::istreambuf_iterator<char>(in), {});
  expect_says(text, {"<!doctype html>", "<td><b>10.00</b></td>"});
  EXPECT_EQ(text.find("://"), std::string::npos);
}

TEST(CompareTable, TextIsMadeSafe) {
  Table table{{"recording", "run"}, {{"k", "a_b", "50 %", 1, true}}, {{"<x>", "r|s_1", "", {{1, 2, false}}}}};
  expect_says(table_as(TableFormat::kHtml, table), {"&lt;x&gt;"});
  expect_says(table_as(TableFormat::kMarkdown, table), {"r\\|s_1", "1.0 (+2.0 %)"});
  expect_says(table_as(TableFormat::kLatex, table),
              {"r|s\\_1 & 1.0 & $+2.0$\\,\\%", "\\multicolumn{2}{r}{50 \\%}"});
}

TEST(CompareFolders, NamesAndConfigurationsComeFromFoldersAndOptions) {
  const TempDir dir;
  const std::vector<fs::path> dirs = {write_compared_run(dir, "x/a/desk", "desk", 1, 1),
                                      write_compared_run(dir, "y/a/desk", "desk", 2, 2)};
  auto runs = find_runs(dirs);
  EXPECT_EQ(runs[0].name, "x/a");
  EXPECT_EQ(runs[1].name, "y/a");
  EXPECT_EQ(find_runs({dirs[0], dirs[0]}).size(), 1U);
  runs = find_runs({write_compared_run(dir, "m1", "desk", 1, 1, "a: 2\n"),
                    write_compared_run(dir, "m2", "hall", 1, 1, "a: 2\n"),
                    write_compared_run(dir, "m3", "hall", 1, 1, "a: 3\n")});
  EXPECT_EQ(runs[0].configuration, "m1, m2") << "the same options on two recordings";
  EXPECT_EQ(runs[1].configuration, "m1, m2");
  EXPECT_EQ(runs[2].configuration, "m3");
}

TEST(CompareFolders, WithoutEvaluationTrajectoriesAreJudged) {
  const TempDir dir;
  const fs::path run = write_compared_run(dir, "r", "data/walk/events.txt", 1, 1);
  for (const char* file : {"evaluation.json", "evaluation_causal.json"}) fs::remove(run / file);
  const Trajectory truth = wavy_walk(100);
  Trajectory estimate = truth;
  for (std::size_t i = 0; i < estimate.size(); ++i) estimate[i].T.p.z() += i % 2 == 0 ? 0.003 : -0.003;
  write_trajectory(run / "groundtruth_camera.txt", truth);
  write_trajectory(run / "trajectory_camera.txt", estimate);
  const Comparison c = compare_runs({run}, {});
  EXPECT_NEAR(value_of(c, "walk", "r", "full_rmse"), 3, 1e-3);
  for (const TableColumn& column : c.table.columns)
    EXPECT_FALSE(column.key.starts_with("causal")) << column.key;
  dir.write("r/evaluation.json", "{");
  EXPECT_FALSE(compare_runs({run}, {}).remarks.empty());
}

}  // namespace
}  // namespace idol::test
