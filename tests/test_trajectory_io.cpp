#include "idol/io/trajectory_io.hpp"

#include "idol/base/diagnostics.hpp"
#include "test_util.hpp"

namespace idol {
namespace {

using test::error_of;
using test::expect_says;
using test::TempDir;

TEST(TrajectoryIo, TrajectoryComesBack) {
  std::mt19937 rng(1);
  Trajectory trajectory;
  for (int i = 0; i < 50; ++i) {
    trajectory.push_back({1'468'939'993'067'416'019 + i * 5'000'001,
                          {quat_exp(test::random_vec3(rng)), test::random_vec3(rng, 10)}});
  }
  const TempDir dir;
  write_trajectory(dir.path() / "t.txt", trajectory);
  const Trajectory back = read_trajectory(dir.path() / "t.txt");
  ASSERT_EQ(back.size(), trajectory.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    EXPECT_EQ(back[i].t, trajectory[i].t);
    EXPECT_LT((back[i].T.p - trajectory[i].T.p).norm(), 1e-8);
    EXPECT_LT(back[i].T.q.angularDistance(trajectory[i].T.q), 1e-8);
    EXPECT_NEAR(back[i].T.q.norm(), 1.0, 1e-15);
  }
}

TEST(TrajectoryIo, TrajectoriesOfOthers) {
  const TempDir dir;
  const Trajectory t =
      read_trajectory(dir.write("t.txt",
                                "# timestamp tx ty tz qx qy qz qw\r\n1.5e0 1 2 3 0 0 0 1\r\n\n"
                                "1.5 1 2 3 0 0 0 1\n2,4,5,6,0,0.7071,0,0.7071"));
  ASSERT_EQ(t.size(), 2u);  // the repeated stamp counts once
  EXPECT_EQ(t[0].t, 1'500'000'000);
  EXPECT_EQ(t[1].T.p, Vec3(4, 5, 6));
  EXPECT_NEAR(t[1].T.q.norm(), 1.0, 1e-15);
}

TEST(TrajectoryIo, DamagedTrajectoriesNameFileAndLine) {
  const TempDir dir;
  const auto error = [&](const std::string& text) {
    const auto path = dir.write("t.txt", text);
    return error_of([&] { read_trajectory(path); });
  };
  const std::string good = "1 0 0 0 0 0 0 1\n";
  expect_says(error(""), {"t.txt", "empty"});
  expect_says(error("# nothing\n"), {"t.txt", "no poses"});
  expect_says(error(good + "2 0 0 0 0 0 1\n"), {"t.txt:2", "7 columns where 8"});
  expect_says(error(good + "2 0 0 nan 0 0 0 1\n"), {"t.txt:2", "'nan'"});
  expect_says(error(good + "2 0 0 0 0 0 0 3\n"), {"t.txt:2", "quaternion"});
  expect_says(error(good + "0.5 0 0 0 0 0 0 1\n"), {"t.txt:2", "0.500000000", "sort"});
  expect_says(error(good + "x 0 0 0 0 0 0 1\n"), {"t.txt:2", "'x'"});
  expect_says(error_of([&] { read_trajectory(dir.path() / "absent.txt"); }), {"absent.txt", "No such file"});
}

TEST(TrajectoryIo, StatesComeBack) {
  std::mt19937 rng(2);
  std::vector<NavState> states(20);
  for (std::size_t i = 0; i < states.size(); ++i) {
    states[i].t = static_cast<Time>(i) * 50'000'000 - 1;
    states[i].T_w_i = {quat_exp(test::random_vec3(rng)), test::random_vec3(rng)};
    states[i].v_w = test::random_vec3(rng);
    states[i].bias = {test::random_vec3(rng, 1e-3), test::random_vec3(rng, 0.1)};
  }
  const TempDir dir;
  write_states(dir.path() / "states.csv", states);
  const auto back = read_states(dir.path() / "states.csv");
  ASSERT_EQ(back.size(), states.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    EXPECT_EQ(back[i].t, states[i].t);
    EXPECT_LT((back[i].T_w_i.p - states[i].T_w_i.p).norm(), 1e-8);
    EXPECT_LT(back[i].T_w_i.q.angularDistance(states[i].T_w_i.q), 1e-10);
    EXPECT_LT((back[i].v_w - states[i].v_w).norm(), 1e-8);
    EXPECT_LT((back[i].bias.gyro - states[i].bias.gyro).norm(), 1e-14);
    EXPECT_LT((back[i].bias.accel - states[i].bias.accel).norm(), 1e-11);
  }
  write_states(dir.path() / "none.csv", {});
  EXPECT_TRUE(read_states(dir.path() / "none.csv").empty());
}

std::vector<Line> two_lines() {
  return {{7, Vec3(1, 2, 3), Vec3(4, 5.5, -6), 1'000'000'001, 2'500'000'000, 12, 3'000'000'000},
          {9, Vec3(0, 0, 0), Vec3(0, 0, 1e-6), 0, 5, 1, 0}};
}

TEST(TrajectoryIo, LinesComeBack) {
  const TempDir dir;
  write_lines_csv(dir.path() / "lines.csv", two_lines());
  const auto back = read_lines_csv(dir.path() / "lines.csv");
  ASSERT_EQ(back.size(), 2u);
  EXPECT_EQ(back[0].id, 7);
  EXPECT_EQ(back[0].b, Vec3(4, 5.5, -6));
  EXPECT_EQ(back[0].first, 1'000'000'001);
  EXPECT_EQ(back[0].last, 2'500'000'000);
  EXPECT_EQ(back[0].windows, 12);
  EXPECT_EQ(back[0].events, 3'000'000'000);
  expect_says(error_of([&] { read_lines_csv(dir.write("l.csv", "1,2,3\n")); }),
              {"l.csv:1", "3 columns where 11"});
}

TEST(TrajectoryIo, PlyHoldsVerticesAndEdges) {
  const TempDir dir;
  write_lines_ply(dir.path() / "lines.ply", two_lines());
  std::ifstream in(dir.path() / "lines.ply");
  std::vector<std::string> rows;
  for (std::string row; std::getline(in, row);) rows.push_back(row);
  EXPECT_EQ(rows[0], "ply");
  const auto end = std::find(rows.begin(), rows.end(), "end_header");
  ASSERT_EQ(rows.end() - end, 1 + 4 + 2);
  EXPECT_NE(std::find(rows.begin(), end, "element vertex 4"), end);
  EXPECT_NE(std::find(rows.begin(), end, "element edge 2"), end);
  EXPECT_EQ(end[2].substr(0, 28), "4.000000 5.500000 -6.000000 ");
  EXPECT_EQ(end[6].substr(0, 4), "2 3 ");
}

TEST(TrajectoryIo, ADiskThatRefusesIsNoticed) {
  const TempDir dir;
  const std::vector<StampedPose> poses(2000);
  for (const std::filesystem::path path : {"/dev/full", "/proc/no/such/place", dir.path().c_str()}) {
    expect_says(error_of([&] { write_trajectory(path, poses); }), {path.string(), "cannot be written"});
    expect_says(error_of([&] { write_states(path, {}); }), {path.string()});
    expect_says(error_of([&] { write_lines_csv(path, two_lines()); }), {path.string()});
    expect_says(error_of([&] { write_lines_ply(path, two_lines()); }), {path.string()});
  }
  expect_says(error_of([&] { write_trajectory("/dev/full", poses); }), {"No space left"});
}

}  // namespace
}  // namespace idol
