#include <nlohmann/json.hpp>

#include "eval_util.hpp"

namespace idol::test {
namespace {

using Json = nlohmann::json;

Json read_json(const std::filesystem::path& path) {
  std::ifstream in(path);
  return Json::parse(in);
}

void expect_stats(const Json& stats, const std::string& where) {
  for (const char* key : {"rmse", "mean", "median", "std", "min", "max"})
    EXPECT_TRUE(stats.contains(key) && stats[key].is_number()) << where << "/" << key;
}

struct EvaluateCli : testing::Test {
  TempDir dir;
  Trajectory walk = wavy_walk(1001, 0.01);  // 10 s
  std::string groundtruth = dir.write("groundtruth.txt", as_text(walk)).string();
  std::string estimate =
      dir.write("trajectory_camera.txt", as_text(moved(walk, {yaw_deg(40), {1, 2, 3}}, 0.5))).string();
  std::string json = (dir.path() / "out.json").string();
};

TEST_F(EvaluateCli, JsonHasTheAgreedShape) {
  const CommandResult result = run_idol("evaluate " + estimate + " " + groundtruth + " --json " + json);
  ASSERT_EQ(result.status, 0) << result.err;
  const Json j = read_json(json);
  EXPECT_EQ(j["matched"], 1001);
  EXPECT_NEAR(j["coverage"].get<double>(), 1.0, 1e-12);
  EXPECT_GT(j["distance_m"].get<double>(), 10.0);
  for (const char* name : {"idol", "uslam", "hku", "full", "sim3"}) {
    ASSERT_TRUE(j["protocols"].contains(name)) << name;
    const Json& p = j["protocols"][name];
    for (const char* key : {"translation_m", "rotation_deg", "yaw_deg"}) expect_stats(p[key], name);
    for (const char* key : {"scale", "mpe_percent", "mye_deg_per_m"})
      EXPECT_TRUE(p[key].is_number()) << name << key;
  }
  EXPECT_NEAR(j["protocols"]["sim3"]["scale"].get<double>(), 2.0, 1e-9);
  EXPECT_EQ(j["protocols"]["full"]["scale"], 1.0);
  const Json& segments = j["protocols"]["segments"];
  EXPECT_EQ(segments.size(), 5u);
  for (const char* percent : {"10", "20", "30", "40", "50"}) {
    ASSERT_TRUE(segments.contains(percent));
    EXPECT_TRUE(segments[percent]["length_m"].is_number());
    EXPECT_GT(segments[percent]["samples"].get<int>(), 0);
    for (const char* key : {"translation_m", "translation_percent", "rotation_deg", "yaw_deg"})
      expect_stats(segments[percent][key], percent);
  }
}

TEST_F(EvaluateCli, FoldersStandForTheirTrajectories) {
  const CommandResult files = run_idol("evaluate " + estimate + " " + groundtruth);
  const CommandResult folders = run_idol("evaluate " + dir.path().string() + " " + dir.path().string());
  EXPECT_EQ(folders.status, 0) << folders.err;
  EXPECT_EQ(files.out, folders.out);
  for (const char* word : {"idol", "uslam", "hku", "full", "sim3", "segments", "MPE"})
    EXPECT_NE(files.out.find(word), std::string::npos) << word;
}

TEST_F(EvaluateCli, ProtocolsMayStandBeforeOrBehindThePaths) {
  const std::string paths = estimate + " " + groundtruth;
  const CommandResult behind = run_idol("evaluate " + paths + " --protocol full hku");
  ASSERT_EQ(behind.status, 0) << behind.err;
  EXPECT_EQ(behind.out.find("uslam"), std::string::npos);
  EXPECT_EQ(behind.out.find("segments"), std::string::npos);
  EXPECT_EQ(run_idol("evaluate --protocol full hku " + paths).out, behind.out);
  EXPECT_EQ(run_idol("evaluate " + paths + " --protocol full --protocol hku").out, behind.out);
}

TEST_F(EvaluateCli, FreeAlignmentIsCalledCustom) {
  const auto custom = [&](const std::string& options) {
    const CommandResult result =
        run_idol("evaluate " + estimate + " " + groundtruth + " " + options + " --json " + json);
    EXPECT_EQ(result.status, 0) << result.err;
    return read_json(json)["protocols"];
  };
  const Json sim3 = custom("--align sim3 --align-span 1 4");
  EXPECT_EQ(sim3["custom"]["alignment"]["poses"], 301);
  EXPECT_LT(sim3["custom"]["translation_m"]["max"].get<double>(), 1e-9);
  EXPECT_LT(sim3["segments"]["10"]["translation_m"]["max"].get<double>(), 1e-9);  // at the alignment's scale
  EXPECT_FALSE(sim3.contains("full"));
  EXPECT_EQ(custom("--align posyaw --align-first 7")["custom"]["alignment"]["poses"], 7);
  EXPECT_EQ(custom("--align se3 --until 5")["custom"]["poses"], 501);
  EXPECT_GT(custom("--align none --protocol full")["custom"]["translation_m"]["rmse"].get<double>(), 1.0);
}

TEST_F(EvaluateCli, InterpolationRemovesTheErrorOfTheStamps) {
  Trajectory shifted;
  for (std::size_t i = 0; i + 1 < walk.size(); ++i)
    shifted.push_back({walk[i].t + 4'000'000, interpolate(walk[i].T, walk[i + 1].T, 0.4)});
  const std::string path = dir.write("shifted.txt", as_text(shifted)).string();
  const std::string command = "evaluate " + path + " " + groundtruth + " --align none --json " + json;
  ASSERT_EQ(run_idol(command).status, 0);
  EXPECT_GT(read_json(json)["protocols"]["custom"]["translation_m"]["rmse"].get<double>(), 1e-3);
  ASSERT_EQ(run_idol(command + " --interpolate").status, 0);
  EXPECT_LT(read_json(json)["protocols"]["custom"]["translation_m"]["max"].get<double>(), 1e-9);
}

TEST_F(EvaluateCli, WrongUsageIsStatusTwo) {
  const std::string paths = "evaluate " + estimate + " " + groundtruth;
  for (const std::string& arguments :
       {paths + " --protocol paper", paths + " --align sim4", paths + " --align-first 3",
        paths + " --align se3 --align-first 0", paths + " --align se3 --align-first 3 --align-span 0 1",
        paths + " --align se3 --align-span 4 1", paths + " --align se3 --align-span 4", paths + " --until -1",
        paths + " --until x", paths + " --verbose", "evaluate " + estimate, std::string("evaluate")}) {
    const CommandResult result = run_idol(arguments);
    EXPECT_EQ(result.status, 2) << arguments << "\n" << result.err;
    EXPECT_FALSE(result.err.empty()) << arguments;
  }
}

TEST_F(EvaluateCli, BadDataIsStatusOneWithOneLineThatSaysWhere) {
  const std::string empty = dir.write("empty.txt", "").string();
  const std::string comments = dir.write("comments.txt", "# t tx ty tz qx qy qz qw\n").string();
  const std::string cut = dir.write("cut.txt", "0.0 1 2 3 0 0 0 1\n0.1 1 2 3 0 0\n").string();
  const std::string garbage = dir.write("garbage.txt", std::string("\x7f"
                                                                   "ELF\0\x01\xff\xfe\n",
                                                                   9))
                                  .string();
  const std::string nan = dir.write("nan.txt", "0.0 1 nan 3 0 0 0 1\n").string();
  Trajectory later = walk;
  for (StampedPose& pose : later) pose.t += from_seconds(1000);
  const std::string other = dir.write("other.txt", as_text(later)).string();
  const std::string missing = (dir.path() / "missing.txt").string();
  for (const std::string& bad : {empty, comments, cut, garbage, nan, other, missing}) {
    for (const std::string& paths : {bad + " " + groundtruth, estimate + " " + bad}) {
      const CommandResult result = run_idol("evaluate " + paths);
      EXPECT_EQ(result.status, 1) << paths;
      EXPECT_NE(result.err.find(bad), std::string::npos) << result.err;
      EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
      EXPECT_TRUE(result.out.empty()) << result.out;
    }
  }
}

TEST_F(EvaluateCli, TooFewPosesSayHowMany) {
  const CommandResult first =
      run_idol("evaluate " + estimate + " " + groundtruth + " --align se3 --align-first 2000");
  EXPECT_EQ(first.status, 1);
  EXPECT_NE(first.err.find("2000"), std::string::npos) << first.err;
  EXPECT_NE(first.err.find("1001"), std::string::npos) << first.err;
  const CommandResult span =
      run_idol("evaluate " + estimate + " " + groundtruth + " --protocol uslam --until 2");
  EXPECT_EQ(span.status, 1);
  EXPECT_NE(span.err.find("found 0"), std::string::npos) << span.err;
}

TEST_F(EvaluateCli, JsonThatCannotBeWrittenIsStatusOne) {
  const std::string path = (dir.path() / "no_such_folder" / "out.json").string();
  const CommandResult result = run_idol("evaluate " + estimate + " " + groundtruth + " --json " + path);
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.err.find(path), std::string::npos) << result.err;
}

TEST_F(EvaluateCli, FiguresWithoutSamplesAreNull) {
  Trajectory still = wavy_walk(200, 0.05);
  for (StampedPose& pose : still) pose.T.p.setZero();
  const std::string path = dir.write("still.txt", as_text(still)).string();
  ASSERT_EQ(run_idol("evaluate " + path + " " + path + " --json " + json).status, 0);
  const Json j = read_json(json);
  EXPECT_TRUE(j["protocols"]["full"]["mpe_percent"].is_null());
  EXPECT_EQ(j["protocols"]["segments"]["10"]["samples"], 0);
  EXPECT_TRUE(j["protocols"]["segments"]["10"]["translation_m"]["rmse"].is_null());
}

TEST(EvaluateSharedData, RealMotionCaptureAgainstItself) {
  const std::filesystem::path path = std::filesystem::path(IDOL_SHARED_DATA_DIR) / "real/rpg_poster_6dof";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not on this machine";
  TempDir dir;
  const std::string json = (dir.path() / "out.json").string();
  const CommandResult result =
      run_idol("evaluate " + (path / "groundtruth.txt").string() + " " + path.string() + " --json " + json);
  ASSERT_EQ(result.status, 0) << result.err;
  const Json j = read_json(json);
  EXPECT_EQ(j["matched"], 11610);
  EXPECT_NEAR(j["distance_m"].get<double>(), 61, 1);
  for (const char* name : {"idol", "uslam", "hku", "full", "sim3"})
    EXPECT_LT(j["protocols"][name]["translation_m"]["max"].get<double>(), 1e-9) << name;
}

}  // namespace
}  // namespace idol::test
