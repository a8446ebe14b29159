#include "idol/eval/alignment.hpp"

#include <algorithm>
#include <set>
#include <tuple>

#include "eval_util.hpp"
#include "idol/base/diagnostics.hpp"

namespace idol::test {
namespace {

/// All pairs within reach, sorted, taken greedily: the definition itself, O(n^2 log n).
std::vector<Match> associate_by_brute_force(const Trajectory& estimate, const Trajectory& groundtruth,
                                            double max_difference_s) {
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < estimate.size(); ++i)
    for (std::size_t j = 0; j < groundtruth.size(); ++j) {
      const double d = std::abs(stamp_seconds(estimate[i].t) - stamp_seconds(groundtruth[j].t));
      if (d < max_difference_s) pairs.emplace_back(d, i, j);
    }
  std::sort(pairs.begin(), pairs.end());
  std::set<std::size_t> used_estimate;
  std::set<std::size_t> used_groundtruth;
  std::vector<Match> matches;
  for (const auto& [d, i, j] : pairs)
    if (used_estimate.count(i) == 0 && used_groundtruth.count(j) == 0) {
      used_estimate.insert(i);
      used_groundtruth.insert(j);
      matches.push_back({i, j});
    }
  std::sort(matches.begin(), matches.end(),
            [](const Match& a, const Match& b) { return a.estimate < b.estimate; });
  return matches;
}

Trajectory random_stamps(std::mt19937& rng, std::size_t n, Time grid, Time span, Time origin) {
  std::set<Time> stamps;
  std::uniform_int_distribution<Time> step(0, span / grid);
  while (stamps.size() < n) stamps.insert(origin + grid * step(rng));
  Trajectory trajectory;
  for (const Time t : stamps) trajectory.push_back({t, {}});
  return trajectory;
}

using Matches = std::vector<Match>;

TEST(Association, NearestStampWithinTwoHundredths) {
  const Matches matches =
      associate(at_seconds({0.004, 1.0, 2.019, 3.021}), at_seconds({0, 0.005, 1.001, 2.0, 3.0}));
  EXPECT_EQ(matches, (Matches{{0, 1}, {1, 2}, {2, 3}}));
}

TEST(Association, ClosestPairGoesFirstAndTakesThePose) {
  // Both estimates are nearest to the ground truth at 1.000; the closer one has it, the other takes what is
  // left.
  EXPECT_EQ(associate(at_seconds({0.995, 1.001}), at_seconds({0.98, 1.000})), (Matches{{0, 0}, {1, 1}}));
  EXPECT_EQ(associate(at_seconds({0.995, 1.001}), at_seconds({1.000})), (Matches{{1, 0}}));
}

TEST(Association, TiesGoToTheEarlierPose) {
  // 0.25 and 0.75 are exact in binary, so the differences tie exactly.
  EXPECT_EQ(associate(at_seconds({0.5}), at_seconds({0.25, 0.75}), 1.0), (Matches{{0, 0}}));
  EXPECT_EQ(associate(at_seconds({0.25, 0.75}), at_seconds({0.5}), 1.0), (Matches{{0, 0}}));
}

TEST(Association, EqualsBruteForceOnRandomStamps) {
  std::mt19937 rng(5);
  for (int trial = 0; trial < 300; ++trial) {
    // Coarse grids make ties and equal stamps common; Unix time makes doubles coarse.
    const Time grid = trial % 3 == 0 ? 1 : trial % 3 == 1 ? 1'000'000 : 5'000'000;
    const Time origin = trial % 2 == 0 ? 0 : 1'500'000'000'000'000'000;
    const auto estimate = random_stamps(rng, 1 + rng() % 60, grid, 1'000'000'000, origin);
    const auto groundtruth = random_stamps(rng, 1 + rng() % 90, grid, 1'000'000'000, origin);
    ASSERT_EQ(associate(estimate, groundtruth), associate_by_brute_force(estimate, groundtruth, 0.02))
        << trial;
  }
}

TEST(Association, LongTrajectoriesTakeNoTime) {
  // Every stamp of one is within reach of thousands of the other.
  const auto dense = [](Time offset) {
    Trajectory trajectory(300'000);
    for (std::size_t i = 0; i < trajectory.size(); ++i)
      trajectory[i].t = static_cast<Time>(i) * 1000 + offset;
    return trajectory;
  };
  EXPECT_EQ(associate(dense(0), dense(300)).size(), 300'000u);
}

TEST(Association, NothingToMatch) {
  EXPECT_TRUE(associate({}, at_seconds({1})).empty());
  EXPECT_TRUE(associate(at_seconds({1}), {}).empty());
  EXPECT_TRUE(associate(at_seconds({1}), at_seconds({2})).empty());
}

TEST(Association, StampsAreTheDoublesThatATextParserGives) {
  EXPECT_EQ(stamp_seconds(1), 0.000000001);
  EXPECT_EQ(stamp_seconds(43'352'770), 0.043352770);
  EXPECT_EQ(stamp_seconds(-1'250'000'001), -1.250000001);
  EXPECT_EQ(stamp_seconds(1'468'940'293'840'918'001), 1468940293.840918001);
  EXPECT_EQ(stamp_seconds(1'403'636'579'763'555'584), 1403636579.763555584);
}

TEST(Association, InterpolatesGroundTruthAtTheEstimatesTime) {
  const Trajectory groundtruth = {pose_at(0, {0, 0, 0}), pose_at(0.08, {0.8, 0, 0}, yaw_deg(40)),
                                  pose_at(1.0, {2, 0, 0})};
  const MatchedPoses pairs = match_interpolated(at_seconds({-0.01, 0.02, 0.08, 0.5, 1.0, 1.01}), groundtruth);
  ASSERT_EQ(pairs.size(), 3u);  // outside, and in the hole of 0.92 s: dropped
  EXPECT_NEAR(pairs.groundtruth[0].T.p.x(), 0.2, 1e-12);
  EXPECT_NEAR(pairs.groundtruth[0].T.q.angularDistance(yaw_deg(10)), 0, 1e-9);
  EXPECT_EQ(pairs.groundtruth[1].T.p.x(), 0.8);
  EXPECT_EQ(pairs.groundtruth[2].T.p.x(), 2.0);
}

TEST(Coverage, HolesAndWhatLiesOutsideDoNotCount) {
  Trajectory estimate;
  for (int i = 0; i <= 20; ++i) estimate.push_back(pose_at(2 + 0.1 * i, Vec3::Zero()));  // 2..4 s
  EXPECT_NEAR(time_coverage(estimate, 0, from_seconds(8)), 0.25, 1e-12);
  EXPECT_NEAR(time_coverage(estimate, from_seconds(3), from_seconds(5)), 0.5, 1e-12);
  for (int i = 0; i <= 10; ++i) estimate.push_back(pose_at(7 + 0.1 * i, Vec3::Zero()));  // hole 4..7 s
  EXPECT_NEAR(time_coverage(estimate, 0, from_seconds(8)), 0.375, 1e-12);
  EXPECT_EQ(time_coverage({}, 0, from_seconds(8)), 0);
  EXPECT_EQ(time_coverage(estimate, 5, 5), 0);
}

TEST(Coverage, SlowlyPublishedPosesAreNoHoles) {
  Trajectory estimate;
  for (int i = 0; i <= 4; ++i) estimate.push_back(pose_at(2 * i, Vec3::Zero()));
  EXPECT_NEAR(time_coverage(estimate, 0, from_seconds(8)), 1.0, 1e-12);
}

// ----------------------------------------------------------------------------------------------------
// alignment

void expect_undone(const Trajectory& groundtruth, const Trajectory& estimate, AlignmentKind kind,
                   double scale = 1) {
  const Alignment alignment = align({estimate, groundtruth}, kind);
  EXPECT_NEAR(alignment.T.scale, scale, 1e-9);
  EXPECT_NEAR(alignment.T.R.determinant(), 1.0, 1e-12);
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const Pose aligned = alignment.T * estimate[i].T;
    EXPECT_LT((aligned.p - groundtruth[i].T.p).norm(), 1e-9);
    EXPECT_LT(quat_log((aligned.q * groundtruth[i].T.q.conjugate()).normalized()).norm(), 1e-7);
  }
}

const Pose kYawed{yaw_deg(130), {3, -2, 1}};
const Pose kTurned{quat_exp({0.7, -1.1, 2.0}), {3, -2, 1}};

TEST(Alignment, UndoesKnownMoves) {
  const Trajectory groundtruth = wavy_walk(80);
  expect_undone(groundtruth, groundtruth, AlignmentKind::kNone);
  expect_undone(groundtruth, moved(groundtruth, kYawed), AlignmentKind::kPosYaw);
  expect_undone(groundtruth, moved(groundtruth, kTurned), AlignmentKind::kSe3);
  expect_undone(groundtruth, moved(groundtruth, kTurned, 0.8), AlignmentKind::kSim3, 1.25);
}

TEST(Alignment, NoneLeavesTheEstimateAlone) {
  const Trajectory groundtruth = wavy_walk(10);
  const Trajectory estimate = moved(groundtruth, kTurned);
  const Alignment alignment = align({estimate, groundtruth}, AlignmentKind::kNone);
  EXPECT_EQ(alignment.T.R, Mat3::Identity());
  EXPECT_EQ(alignment.T.t, Vec3::Zero());
}

TEST(Alignment, PosYawNeverTilts) {
  const Trajectory groundtruth = wavy_walk(80);
  const Alignment alignment = align({moved(groundtruth, kTurned), groundtruth}, AlignmentKind::kPosYaw);
  EXPECT_NEAR((alignment.T.R * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 0, 1e-12);
}

TEST(Alignment, NoSmallMoveOfTheSolutionIsBetter) {
  std::mt19937 rng(3);
  const Trajectory groundtruth = wavy_walk(60);
  Trajectory estimate = moved(groundtruth, kTurned, 0.9);
  for (StampedPose& pose : estimate) pose.T.p += random_vec3(rng, 0.1);
  for (const AlignmentKind kind : {AlignmentKind::kPosYaw, AlignmentKind::kSe3, AlignmentKind::kSim3}) {
    const Similarity best = align({estimate, groundtruth}, kind).T;
    const auto cost = [&](const Similarity& T) {
      double sum = 0;
      for (std::size_t i = 0; i < estimate.size(); ++i)
        sum += ((T * estimate[i].T).p - groundtruth[i].T.p).squaredNorm();
      return sum;
    };
    for (int trial = 0; trial < 50; ++trial) {
      Similarity other = best;
      Vec3 turn = random_vec3(rng, 1e-2);
      if (kind == AlignmentKind::kPosYaw) turn.head<2>().setZero();
      other.R = so3_exp(turn) * other.R;
      other.t += random_vec3(rng, 1e-2);
      if (kind == AlignmentKind::kSim3) other.scale *= 1 + 1e-2 * turn.z();
      EXPECT_GE(cost(other), cost(best)) << alignment_name(kind);
    }
  }
}

TEST(Alignment, MirroredPositionsStillGiveARotation) {
  const Trajectory groundtruth = wavy_walk(40);
  Trajectory estimate = groundtruth;
  for (StampedPose& pose : estimate) pose.T.p.z() *= -1;
  const Alignment alignment = align({estimate, groundtruth}, AlignmentKind::kSim3);
  EXPECT_NEAR(alignment.T.R.determinant(), 1.0, 1e-12);
  EXPECT_LT(alignment.T.scale, 1.0);
}

TEST(Alignment, OnePoseAlignsByItsOrientation) {
  const Trajectory groundtruth = {pose_at(0, {1, 2, 3}, quat_exp({0.1, -0.4, 1.0}))};
  expect_undone(groundtruth, moved(groundtruth, kYawed), AlignmentKind::kPosYaw);
  expect_undone(groundtruth, moved(groundtruth, kTurned), AlignmentKind::kSe3);
  expect_undone(groundtruth, moved(groundtruth, kTurned, 2.0), AlignmentKind::kSim3);  // scale stays 1
}

TEST(Alignment, PositionsAllInOnePlaceAlignByTheOrientations) {
  Trajectory groundtruth = wavy_walk(30);
  for (StampedPose& pose : groundtruth) pose.T.p = {0.1, 0.2, 0.3};
  for (const auto& [kind, T] :
       {std::pair{AlignmentKind::kPosYaw, kYawed}, std::pair{AlignmentKind::kSe3, kTurned},
        std::pair{AlignmentKind::kSim3, kTurned}}) {
    expect_undone(groundtruth, moved(groundtruth, T), kind);
    EXPECT_TRUE(align({moved(groundtruth, T), groundtruth}, kind).from_rotations);
  }
}

TEST(Alignment, PositionsOnALineLeaveTheTurnAboutItToTheOrientations) {
  Trajectory groundtruth = wavy_walk(30);
  for (std::size_t i = 0; i < groundtruth.size(); ++i)
    groundtruth[i].T.p = Vec3(1, 2, -1) * (0.1 * static_cast<double>(i));
  expect_undone(groundtruth, moved(groundtruth, kTurned), AlignmentKind::kSe3);
  expect_undone(groundtruth, moved(groundtruth, kTurned, 0.5), AlignmentKind::kSim3, 2.0);
  // A vertical line says nothing about the yaw.
  for (std::size_t i = 0; i < groundtruth.size(); ++i)
    groundtruth[i].T.p = {0, 0, 0.1 * static_cast<double>(i)};
  expect_undone(groundtruth, moved(groundtruth, kYawed), AlignmentKind::kPosYaw);
}

TEST(Alignment, SelectsByNumberAndByTime) {
  const Trajectory walk = wavy_walk(100, 0.1);  // 0 .. 9.9 s
  const MatchedPoses pairs{walk, walk};
  EXPECT_EQ(select_poses(pairs, 0, {}).size(), 100u);
  EXPECT_EQ(select_poses(pairs, 0, {.first = 7, .seconds = {}}).size(), 7u);
  EXPECT_EQ(select_poses(pairs, 0, {.first = 700, .seconds = {}}).size(), 100u);
  const MatchedPoses span =
      select_poses(pairs, from_seconds(1.0), {.first = {}, .seconds = std::pair{2.0, 4.0}});
  ASSERT_EQ(span.size(), 21u);  // both ends belong to it
  EXPECT_EQ(span.estimate.front().t, from_seconds(3.0));
  EXPECT_EQ(span.estimate.back().t, from_seconds(5.0));
}

TEST(Alignment, WithoutPosesIsAnError) {
  EXPECT_THROW(align({}, AlignmentKind::kSe3), DataError);
  EXPECT_THROW(align_yaw_from_rotations({}), DataError);
}

TEST(Alignment, YawFromRotationsIgnoresWhereTheNoiseLeads) {
  std::mt19937 rng(2);
  Trajectory groundtruth = wavy_walk(50, 0.001);
  Trajectory estimate = moved(groundtruth, kYawed);
  for (StampedPose& pose : estimate) pose.T.p += random_vec3(rng, 0.02);
  const Mat3 R = align_yaw_from_rotations({estimate, groundtruth}).T.R;
  EXPECT_LT(so3_log(R * kYawed.R()).norm(), 1e-6);
}

TEST(Alignment, NamesAreTheirOwnInverse) {
  for (const char* name : {"none", "posyaw", "se3", "sim3"})
    EXPECT_EQ(alignment_name(*parse_alignment_kind(name)), name);
  EXPECT_FALSE(parse_alignment_kind("SE3").has_value());
}

}  // namespace
}  // namespace idol::test
