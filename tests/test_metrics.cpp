#include "idol/eval/metrics.hpp"

#include <cmath>

#include "eval_util.hpp"
#include "idol/base/diagnostics.hpp"
#include "idol/eval/protocols.hpp"

namespace idol::test {
namespace {

TEST(Statistics, OfAHandfulOfNumbers) {
  const Stats s = statistics({4, 1, 3, 2});
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(30.0 / 4.0));
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(1.25));  // of the population, not of a sample
  EXPECT_DOUBLE_EQ(s.min, 1);
  EXPECT_DOUBLE_EQ(s.max, 4);
  EXPECT_DOUBLE_EQ(statistics({5, 1, 2}).median, 2);
}

TEST(Statistics, OfNothingIsNotANumber) {
  const Stats s = statistics({});
  for (const double v : {s.rmse, s.mean, s.median, s.std, s.min, s.max}) EXPECT_TRUE(std::isnan(v));
}

TEST(RotationError, PureAndMixedTurns) {
  const RotationError yaw = rotation_error(yaw_deg(-30));
  EXPECT_NEAR(yaw.angle_deg, 30, 1e-12);
  EXPECT_NEAR(yaw.yaw_deg, 30, 1e-12);
  EXPECT_NEAR(yaw.tilt_deg, 0, 1e-12);
  const RotationError roll = rotation_error(quat_exp({0.1, 0, 0}));
  EXPECT_NEAR(roll.yaw_deg, 0, 1e-12);
  EXPECT_NEAR(roll.tilt_deg, 0.1 / kRad, 1e-12);
  const Quat q = yaw_deg(20) * quat_exp({0, 3 * kRad, 0}) * quat_exp({4 * kRad, 0, 0});  // z, then y, then x
  EXPECT_NEAR(rotation_error(q).yaw_deg, 20, 1e-12);
  EXPECT_NEAR(rotation_error(q).tilt_deg, 5, 1e-12);
}

TEST(AbsoluteErrors, OfAKnownOffsetAndTurn) {
  const Trajectory groundtruth = wavy_walk(40);
  Trajectory estimate = groundtruth;
  for (StampedPose& pose : estimate)
    pose.T = {(yaw_deg(5) * pose.T.q).normalized(), pose.T.p + Vec3(0.03, 0, -0.04)};
  const AbsoluteErrors errors = absolute_errors({estimate, groundtruth}, {});
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    EXPECT_NEAR(errors.translation_m[i], 0.05, 1e-12);
    EXPECT_NEAR(errors.rotation_deg[i], 5, 1e-9);
    EXPECT_NEAR(errors.yaw_deg[i], 5, 1e-9);
    EXPECT_NEAR(errors.tilt_deg[i], 0, 1e-9);
  }
}

TEST(AbsoluteErrors, ScaleOfSim3ActsOnPositionsOnly) {
  const Trajectory groundtruth = {pose_at(0, {2, 0, 0}), pose_at(1, {4, 0, 0})};
  const Trajectory estimate = {pose_at(0, {1, 0, 0}), pose_at(1, {2, 0, 0.5})};
  const AbsoluteErrors errors =
      absolute_errors({estimate, groundtruth}, {.scale = 2, .R = Mat3::Identity(), .t = Vec3::Zero()});
  EXPECT_NEAR(errors.translation_m[0], 0, 1e-15);
  EXPECT_NEAR(errors.translation_m[1], 1, 1e-15);
}

TEST(Lengths, PathAndItsMatchedPart) {
  const Trajectory groundtruth = {pose_at(0, {0, 0, 0}), pose_at(1, {3, 4, 0}), pose_at(2, {3, 4, 2}),
                                  pose_at(3, {3, 4, 1}), pose_at(4, {0, 4, 1})};
  EXPECT_EQ(accumulated_distances(groundtruth), (std::vector<double>{0, 5, 7, 8, 11}));
  EXPECT_EQ(path_length(groundtruth), 11);
  EXPECT_EQ(path_length({}), 0);
  // Matched at 1 s and 3 s only: the pose between them still counts.
  const MatchedPoses pairs{at_seconds({1, 3}), {groundtruth[1], groundtruth[3]}};
  EXPECT_EQ(matched_length(pairs, groundtruth), 3);
  // Interpolated ends are the ends of the path.
  const MatchedPoses between{at_seconds({0.5, 3}), {pose_at(0.5, {1.5, 2, 0}), groundtruth[3]}};
  EXPECT_EQ(matched_length(between, groundtruth), 5.5);
  EXPECT_EQ(matched_length({}, groundtruth), 0);
}

TEST(Segments, LengthIsCutToWholeCentimetres) {
  EXPECT_DOUBLE_EQ(segment_length(10, 61.3999), 6.13);
  EXPECT_DOUBLE_EQ(segment_length(50, 3.3999), 1.69);
  EXPECT_DOUBLE_EQ(segment_length(10, 0.09), 0.0);
}

/// The search as defined, O(n^2).
std::vector<std::size_t> ends_by_brute_force(const std::vector<double>& d, double length) {
  std::vector<std::size_t> ends(d.size(), kNoSegmentEnd);
  for (std::size_t i = 0; i < d.size(); ++i) {
    double best = 0.2 * length;
    for (std::size_t j = i; j < d.size(); ++j)
      if (std::abs(d[j] - (d[i] + length)) < best) {
        best = std::abs(d[j] - (d[i] + length));
        ends[i] = j;
      }
  }
  return ends;
}

TEST(Segments, EndsAreTheClosestWithinAFifth) {
  // From 0.5 on, 1.1 is too short by 0.4 and 2.0 too long by 0.5.
  const std::vector<double> d = {0, 0.5, 1.1, 2.0};
  const auto ends = segment_ends(d, 1.0);
  EXPECT_EQ(ends, (std::vector<std::size_t>{2, kNoSegmentEnd, 3, kNoSegmentEnd}));
}

TEST(Segments, EndsEqualBruteForceWithPausesAndJumps) {
  std::mt19937 rng(11);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> d = {0};
    for (int i = 0; i < 120; ++i) {
      const int kind = static_cast<int>(rng() % 10);
      d.push_back(d.back() + (kind < 3 ? 0.0 : kind < 9 ? 0.02 : 0.5));  // still, walking (ties), jumping
    }
    for (const double length : {0.03, 0.1, 0.5, 2.0})
      ASSERT_EQ(segment_ends(d, length), ends_by_brute_force(d, length));
  }
}

TEST(RelativeErrors, OfAStraightWalkWithScaleErrorAndTurn) {
  // 1 m steps along x; the estimate walks 3 % too far, then (second part) yaws 0.5 deg at each step.
  Trajectory groundtruth;
  Trajectory estimate;
  for (int i = 0; i < 11; ++i) {
    groundtruth.push_back(pose_at(i, {1.0 * i, 0, 0}));
    estimate.push_back(pose_at(i, {1.03 * i, 0, 0}));
  }
  const RelativeErrors e = relative_errors({estimate, groundtruth}, 4.0, 1.0);
  ASSERT_EQ(e.translation_m.size(), 7u);
  for (const double v : e.translation_m) EXPECT_NEAR(v, 0.12, 1e-12);
  for (const double v : e.translation_percent) EXPECT_NEAR(v, 3.0, 1e-10);
  const RelativeErrors scaled = relative_errors({estimate, groundtruth}, 4.0, 1 / 1.03);
  for (const double v : scaled.translation_m) EXPECT_NEAR(v, 0, 1e-12);

  for (int i = 0; i < 11; ++i) estimate[static_cast<std::size_t>(i)].T = {yaw_deg(0.5 * i), {1.0 * i, 0, 0}};
  const RelativeErrors turned = relative_errors({estimate, groundtruth}, 4.0, 1.0);
  for (const double v : turned.rotation_deg) EXPECT_NEAR(v, 2.0, 1e-9);
  for (const double v : turned.rotation_deg_per_m) EXPECT_NEAR(v, 0.5, 1e-9);
  for (const double v : turned.yaw_deg) EXPECT_NEAR(v, 2.0, 1e-9);
  for (const double v : turned.tilt_deg) EXPECT_NEAR(v, 0.0, 1e-9);
}

TEST(RelativeErrors, YawIsAboutTheWorldsVerticalWhateverTheCameraLooksAt) {
  // A camera that looks forward (its y axis down) and drifts about the vertical.
  const Quat forward = quat_exp({-90 * kRad, 0, 0});
  Trajectory groundtruth;
  Trajectory estimate;
  for (int i = 0; i < 6; ++i) {
    groundtruth.push_back(pose_at(i, {0, 1.0 * i, 0}, forward));
    estimate.push_back(pose_at(i, {0, 1.0 * i, 0}, yaw_deg(i) * forward));
  }
  const RelativeErrors e = relative_errors({estimate, groundtruth}, 3.0, 1.0);
  ASSERT_FALSE(e.yaw_deg.empty());
  for (const double v : e.yaw_deg) EXPECT_NEAR(v, 3.0, 1e-9);
  for (const double v : e.tilt_deg) EXPECT_NEAR(v, 0.0, 1e-9);
}

TEST(RelativeErrors, DoNotChangeWithAMoveOfTheWholeEstimate) {
  std::mt19937 rng(4);
  const Trajectory groundtruth = wavy_walk(200);
  Trajectory estimate = groundtruth;
  for (StampedPose& pose : estimate) pose.T.p += random_vec3(rng, 0.02);
  const Trajectory elsewhere = moved(estimate, {quat_exp({0.3, 0.2, 1.0}), {1, 2, 3}});
  const RelativeErrors a = relative_errors({estimate, groundtruth}, 2.0, 1.0);
  const RelativeErrors b = relative_errors({elsewhere, groundtruth}, 2.0, 1.0);
  ASSERT_EQ(a.translation_m.size(), b.translation_m.size());
  for (std::size_t i = 0; i < a.translation_m.size(); ++i)
    EXPECT_NEAR(a.translation_m[i], b.translation_m[i], 1e-9);
}

// ----------------------------------------------------------------------------------------------------
// protocols

ProtocolResult find(const Evaluation& evaluation, const std::string& name) {
  for (const ProtocolResult& result : evaluation.protocols)
    if (result.protocol.name == name) return result;
  throw std::runtime_error("no protocol " + name);
}

TEST(Protocols, AllOfThemOnAPerfectEstimate) {
  const Trajectory groundtruth = wavy_walk(1001, 0.01);  // 10 s
  const Evaluation evaluation = evaluate(moved(groundtruth, {yaw_deg(130), {3, -2, 1}}), groundtruth, {});
  EXPECT_EQ(evaluation.matched, 1001u);
  EXPECT_NEAR(evaluation.coverage, 1.0, 1e-12);
  EXPECT_NEAR(evaluation.distance_m, path_length(groundtruth), 1e-12);
  ASSERT_EQ(evaluation.protocols.size(), 5u);
  for (const ProtocolResult& result : evaluation.protocols) {
    EXPECT_LT(result.figures.translation_m.max, 1e-9) << result.protocol.name;
    EXPECT_LT(result.figures.rotation_deg.max, 1e-5) << result.protocol.name;
  }
  ASSERT_EQ(evaluation.segments.size(), 5u);
  EXPECT_LT(evaluation.segments[2].translation_percent.max, 1e-7);
}

TEST(Protocols, FullGivesMpeAndMyeByHand) {
  // Mirrored offsets of 2 cm about a 10 m walk do not move the alignment: MPE = 0.02 / 10.
  Trajectory groundtruth;
  Trajectory estimate;
  for (int i = 0; i <= 100; ++i) {
    const Vec3 p(0.1 * i, 0, 0);
    groundtruth.push_back(pose_at(0.1 * i, p));
    estimate.push_back(pose_at(0.1 * i, p + Vec3(0, 0, i % 2 == 0 ? 0.02 : -0.02), yaw_deg(1)));
  }
  groundtruth.push_back(pose_at(10.5, {99, 0, 0}));  // beyond the last match: no part of the length
  const Evaluation evaluation =
      evaluate(estimate, groundtruth, {.protocols = {"full"}, .custom = {}, .until_s = {}});
  const AbsoluteFigures f = find(evaluation, "full").figures;
  EXPECT_NEAR(evaluation.distance_m, 10.0, 1e-9);
  EXPECT_NEAR(f.mpe_percent, 0.2, 1e-3);
  EXPECT_NEAR(f.mye_deg_per_m, 0.1, 1e-3);
  EXPECT_EQ(evaluation.segments.size(), 0u);
}

TEST(Protocols, IdolJudgesFortySecondsAndAlignsOnFiftyPoses) {
  Trajectory groundtruth = wavy_walk(1201, 0.05);  // 60 s
  Trajectory estimate = groundtruth;
  for (std::size_t i = 50; i < estimate.size(); ++i) estimate[i].T.p.x() += 0.5;  // behind the aligned ones
  for (StampedPose& pose : estimate)
    if (pose.t > from_seconds(40)) pose.T.p.x() += 100;  // behind the judged ones
  const Evaluation evaluation =
      evaluate(estimate, groundtruth, {.protocols = {"idol"}, .custom = {}, .until_s = {}});
  const ProtocolResult result = find(evaluation, "idol");
  EXPECT_EQ(result.poses, 801u);
  EXPECT_EQ(result.alignment.poses, 50u);
  EXPECT_NEAR(result.figures.translation_m.max, 0.5, 1e-9);
  EXPECT_NEAR(result.figures.translation_m.min, 0.0, 1e-9);
  EXPECT_FALSE(result.yaw_from_rotations.has_value());
}

TEST(Protocols, IdolAfterAStillStartShowsTheYawFromTheRotationsBeside) {
  std::mt19937 rng(9);
  Trajectory groundtruth = wavy_walk(400, 0.02);
  for (std::size_t i = 0; i < 60; ++i) groundtruth[i].T.p = groundtruth[60].T.p + random_vec3(rng, 1e-3);
  Trajectory estimate = groundtruth;
  for (std::size_t i = 0; i < 60; ++i) estimate[i].T.p += random_vec3(rng, 2e-3);
  const ProtocolResult result =
      find(evaluate(estimate, groundtruth, {.protocols = {"idol"}, .custom = {}, .until_s = {}}), "idol");
  ASSERT_TRUE(result.yaw_from_rotations.has_value());
  EXPECT_LT(result.alignment.span_m, kStillSpan);
  EXPECT_LT(result.yaw_from_rotations->translation_m.rmse, 5e-3);
  EXPECT_GT(result.figures.translation_m.rmse, 0.1);
  ASSERT_EQ(result.notes.size(), 1u);
  EXPECT_NE(result.notes[0].find("less than 5 cm"), std::string::npos) << result.notes[0];
}

TEST(Protocols, AShortEstimateSkipsWhatItCannotTellUnlessAsked) {
  const Trajectory walk = wavy_walk(40, 0.05);  // 2 s: nothing in seconds 3-8
  const Evaluation evaluation = evaluate(walk, walk, {});
  ASSERT_EQ(evaluation.skipped.size(), 1u);
  EXPECT_EQ(evaluation.skipped[0].first, "uslam");
  EXPECT_EQ(evaluation.protocols.size(), 4u);
  EXPECT_FALSE(find(evaluation, "idol").notes.empty());  // 40 poses instead of 50
  EXPECT_FALSE(find(evaluation, "hku").notes.empty());   // 2 s instead of 5
  EXPECT_THROW(evaluate(walk, walk, {.protocols = {"uslam"}, .custom = {}, .until_s = {}}), DataError);
}

TEST(Protocols, Sim3IsNeverShownAlone) {
  const Trajectory walk = wavy_walk(100);
  const Evaluation evaluation =
      evaluate(moved(walk, {}, 0.5), walk, {.protocols = {"sim3"}, .custom = {}, .until_s = {}});
  ASSERT_EQ(evaluation.protocols.size(), 2u);
  EXPECT_NEAR(find(evaluation, "sim3").figures.scale, 2.0, 1e-9);
  EXPECT_GT(find(evaluation, "full").figures.translation_m.rmse, 0.1);
}

TEST(Protocols, CustomAlignmentLendsItsScaleToTheSegments) {
  const Trajectory walk = wavy_walk(400);
  const Protocol custom{"custom", AlignmentKind::kSim3, {}, {}};
  const Evaluation evaluation =
      evaluate(moved(walk, {}, 0.5), walk, {.protocols = {}, .custom = custom, .until_s = {}});
  ASSERT_EQ(evaluation.protocols.size(), 1u);
  EXPECT_NEAR(evaluation.segment_scale, 2.0, 1e-9);
  EXPECT_LT(evaluation.segments[0].translation_m.max, 1e-9);
}

TEST(Protocols, UntilCutsTheEstimateButNotTheSegmentLengths) {
  const Trajectory walk = wavy_walk(401, 0.05);  // 20 s
  const Evaluation whole = evaluate(walk, walk, {});
  const Evaluation half = evaluate(walk, walk, {.protocols = {}, .custom = {}, .until_s = 10.0});
  EXPECT_EQ(half.matched, 201u);
  EXPECT_NEAR(half.coverage, 1.0, 1e-12);
  EXPECT_LT(half.distance_m, 0.6 * whole.distance_m);
  EXPECT_EQ(half.segments[0].length_m, whole.segments[0].length_m);
}

TEST(Protocols, NothingInCommonSaysTheStampsOfBoth) {
  const Trajectory walk = wavy_walk(21, 0.05);
  Trajectory later = walk;
  for (StampedPose& pose : later) pose.t += from_seconds(100);
  try {
    evaluate(walk, later, {});
    FAIL() << "matched trajectories 100 s apart";
  } catch (const DataError& e) {
    const std::string message = e.what();
    EXPECT_NE(message.find("0.000 to 1.000 s"), std::string::npos) << message;
    EXPECT_NE(message.find("100.000 to 101.000 s"), std::string::npos) << message;
  }
}

TEST(Protocols, BadRequests) {
  const Trajectory walk = wavy_walk(20);
  EXPECT_THROW(evaluate({}, walk, {}), DataError);
  EXPECT_THROW(evaluate(walk, {}, {}), DataError);
  EXPECT_THROW(evaluate(walk, walk, {.protocols = {"all"}, .custom = {}, .until_s = {}}), UsageError);
  const Protocol custom{"custom", AlignmentKind::kSe3, {.first = 21, .seconds = {}}, {}};
  EXPECT_THROW(evaluate(walk, walk, {.protocols = {}, .custom = custom, .until_s = {}}), DataError);
}

TEST(Protocols, AStandstillHasNoMpe) {
  Trajectory groundtruth = wavy_walk(100);
  for (StampedPose& pose : groundtruth) pose.T.p = {1, 1, 1};
  const Evaluation evaluation = evaluate(groundtruth, groundtruth, {});
  EXPECT_TRUE(std::isnan(find(evaluation, "full").figures.mpe_percent));
  EXPECT_NEAR(find(evaluation, "sim3").figures.scale, 1.0, 1e-12);
  for (const SegmentResult& s : evaluation.segments) EXPECT_EQ(s.samples, 0u);
}

}  // namespace
}  // namespace idol::test
