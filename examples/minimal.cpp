// The library in twenty lines: a recording in, its trajectory on standard output.
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "idol/io/reader.hpp"
#include "idol/odometry/presets.hpp"

int main(int argc, char** argv) try {
  if (argc < 2) return std::fprintf(stderr, "usage: minimal SEQUENCE [SECONDS]\n"), 2;
  const idol::Rig rig = idol::load_rig(argv[1]);
  idol::Odometry odometry(rig, idol::preset("realtime"));
  odometry.on_estimate([&](const idol::Estimate& e) {
    const idol::Pose T_w_c = e.state.T_w_i * rig.T_i_c;  // of the camera, in the world
    std::printf("%.6f %.4f %.4f %.4f, %zu lines\n", static_cast<double>(e.state.t) / idol::kNsPerS,
                T_w_c.p.x(), T_w_c.p.y(), T_w_c.p.z(), e.smoother.line_count());
  });
  const auto reader = idol::open_reader(
      argv[1],
      {.width = rig.camera.width, .height = rig.camera.height, .to_s = argc > 2 ? std::atof(argv[2]) : 1e30});
  while (const auto packet = reader->next()) {
    for (const auto& sample : packet->imu) odometry.push(sample);
    odometry.push(packet->events);
  }
  odometry.finish();  // the last window, then one more look at everything; odometry.smoother() has it all
} catch (const std::exception& e) {
  return std::fprintf(stderr, "minimal: %s\n", e.what()), 1;
}
