// A project outside the tree that uses an installed idol: runs on a recording and judges what comes out by its
// ground truth.
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "idol/base/ready_rigs.hpp"
#include "idol/eval/protocols.hpp"
#include "idol/io/reader.hpp"
#include "idol/odometry/presets.hpp"
#include "idol/version.hpp"

int main(int argc, char** argv) try {
  if (argc < 3) return std::fprintf(stderr, "usage: consumer SEQUENCE SECONDS\n"), 2;
  const idol::Rig rig = idol::load_rig(argv[1]);
  idol::Odometry odometry(rig, idol::preset("realtime"));
  idol::Trajectory trajectory;
  odometry.on_estimate(
      [&](const idol::Estimate& e) { trajectory.push_back({e.state.t, e.state.T_w_i * rig.T_i_c}); });
  const auto reader = idol::open_reader(
      argv[1], {.width = rig.camera.width, .height = rig.camera.height, .to_s = std::atof(argv[2])});
  while (const auto packet = reader->next()) {
    for (const auto& sample : packet->imu) odometry.push(sample);
    odometry.push(packet->events);
  }
  odometry.finish();
  const auto truth = idol::read_groundtruth(argv[1]);
  if (!truth) return std::fprintf(stderr, "consumer: no ground truth\n"), 1;
  const idol::Evaluation errors = idol::evaluate(trajectory, *truth, {.protocols = {"full"}});
  std::printf("idol %s: %zu poses, RMSE %.4f m, %zu ready rigs\n", idol::kVersion, trajectory.size(),
              errors.protocols.front().figures.translation_m.rmse, idol::ready_rigs().size());
} catch (const std::exception& e) {
  return std::fprintf(stderr, "consumer: %s\n", e.what()), 1;
}
