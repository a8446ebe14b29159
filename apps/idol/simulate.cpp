#include <fmt/format.h>
#include <unistd.h>

#include <memory>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/io/output_guard.hpp"
#include "idol/io/text_recording_writer.hpp"
#include "idol/io/text_writer.hpp"
#include "idol/io/trajectory_io.hpp"
#include "idol/sim/simulator.hpp"

namespace idol::cli {
namespace {

struct SimulateArguments {
  std::filesystem::path scene, out, rig, imu_rig, trajectory;
  HandMotion motion;
  SimulatorOptions options;
  double imu_rate_hz = 1000;
  double time_offset_s = 0;
  bool noiseless = false, plain_text = false;
  std::vector<double> gyro_bias, accel_bias, dark;
};

// The DAVIS240C of the RPG dataset (Mueggler et al. 2017).
Rig default_rig() {
  Rig rig;
  rig.camera = {240,
                180,
                199.092366542,
                198.82882047,
                132.192071378,
                110.712660011,
                Distortion::kRadTan,
                {-0.368436311798, 0.150947243557, -0.000296130534385, -0.000759431726241, 0}};
  Mat3 R;
  R << 0.999905117246, -0.0122374970355, 0.00632456886338, 0.0121780171243, 0.999882045134, 0.00935904469797,
      -0.00643835413146, -0.00928113597812, 0.99993620202;
  rig.T_i_c = {Quat(R).normalized(), Vec3(0.00674696422488, 0.0007279224709, 0.0342573613538)};
  return rig;
}

Rig make_rig(const SimulateArguments& arguments) {
  Rig rig = arguments.rig.empty() ? default_rig() : load_rig({}, arguments.rig, arguments.imu_rig);
  rig.imu.rate_hz = arguments.imu_rate_hz;
  rig.time_offset_s = arguments.time_offset_s;
  rig.camera.check("the rig");
  return rig;
}

SimulatorOptions make_options(const SimulateArguments& arguments) {
  SimulatorOptions options = arguments.options;
  if (!arguments.dark.empty()) {
    options.dark_from_s = arguments.dark[0];
    options.dark_to_s = arguments.dark[1];
  }
  if (!arguments.gyro_bias.empty()) options.bias.gyro = Vec3(arguments.gyro_bias.data());
  if (!arguments.accel_bias.empty()) options.bias.accel = Vec3(arguments.accel_bias.data());
  if (arguments.noiseless) {
    options.imu_noise_scale = options.background_hz = options.contrast_mismatch = options.jitter_s = 0;
    options.hot_pixels = 0;
  }
  return options;
}

std::string numbers(std::initializer_list<Vec3> vectors, const char* separator) {
  std::string out;
  for (const auto& v : vectors)
    for (int i = 0; i < 3; ++i) out += fmt::format("{}{:.9f}", separator, v[i]);
  return out;
}

void write_true_lines(const std::filesystem::path& path, const Scene& scene) {
  std::string text = "ax,ay,az,bx,by,bz,kind,group,contrast\n";
  for (const auto& line : true_lines(scene))
    text += fmt::format("{},b,-1,{:.3f}\n", numbers({line.a, line.b}, ",").substr(1), line.contrast);
  write_text_file(path, text);
}

void write_truth(const std::filesystem::path& path, const SimulateArguments& arguments, const Rig& rig,
                 const SimulatorOptions& o, std::int64_t events, double duration) {
  write_text_file(
      path,
      fmt::format("# Written by idol simulate. World: z up, gravity 9.81 m/s^2.\nscene: {}\nseed: {}\n"
                  "duration: {:.3f}\ntime_offset_cam_imu: {:.9f}  # t_imu_stamp = t_cam_stamp + offset\n"
                  "event_sensor: {{contrast_on: {}, contrast_off: {}, contrast_sigma_rel: {}, "
                  "refractory_s: {}, background_hz: {}, hot_pixels: {}, jitter_s: {}}}\n"
                  "imu: {{rate: {}, noise_scale: {}}}\nstatistics: {{events: {}}}\n",
                  arguments.scene.filename().string(), o.seed, duration, rig.time_offset_s, o.contrast_on,
                  o.contrast_off, o.contrast_mismatch, o.refractory_s, o.background_hz, o.hot_pixels,
                  o.jitter_s, rig.imu.rate_hz, o.imu_noise_scale, events));
}

Spline make_motion(const SimulateArguments& arguments, const Scene& scene, const Rig& rig) {
  if (!arguments.trajectory.empty())
    return spline_from_trajectory(read_trajectory(arguments.trajectory), rig.T_i_c, arguments.motion.speed);
  HandMotion motion = arguments.motion;
  motion.seed = arguments.options.seed;
  return hand_motion(starting_camera(scene) * rig.T_i_c.inverse(), motion);
}

int run_simulation(const SimulateArguments& arguments) {
  const Scene scene = load_scene(arguments.scene);
  const Rig rig = make_rig(arguments);
  const SimulatorOptions options = make_options(arguments);
  const Spline motion = make_motion(arguments, scene, rig);
  const auto& out = arguments.out;
  InputPaths inputs;
  for (const auto& path : {arguments.scene, arguments.rig, arguments.imu_rig, arguments.trajectory})
    inputs.add(path);
  inputs.refuse_output(out);
  TextRecordingWriter recording(out, !arguments.plain_text);
  write_text_file(out / "camchain-imucam.yaml", rig_to_yaml(rig));
  write_true_lines(out / "lines_truth.csv", scene);

  TextWriter imu(out / "imu.txt"), bias(out / "imu_bias.txt"), truth(out / "imu_truth.txt");
  Trajectory camera;
  std::int64_t count = 0;
  SimulatorSinks sinks;
  sinks.events = [&](std::span<const Event> chunk) {
    recording.add(chunk);
    count += std::ssize(chunk);
  };
  sinks.imu = [&](const ImuSample& s) {
    imu.write(format_stamp(s.t) + numbers({s.accel, s.gyro}, " ") + "\n");
  };
  sinks.truth = [&](const NavState& s) {
    camera.push_back({s.t, s.T_w_i * rig.T_i_c});
    bias.write(format_stamp(s.t) + numbers({s.bias.accel, s.bias.gyro}, " ") + "\n");
    const Quat& q = s.T_w_i.q;
    truth.write(fmt::format("{}{} {:.9f} {:.9f} {:.9f} {:.9f}{}\n", format_stamp(s.t),
                            numbers({s.T_w_i.p}, " "), q.x(), q.y(), q.z(), q.w(), numbers({s.v_w}, " ")));
  };
  if (isatty(STDERR_FILENO) != 0)
    sinks.progress = [&](double t) { fmt::print(stderr, "\r{:6.2f} of {:.2f} s ", t, motion.duration()); };
  simulate(scene, motion, rig, options, sinks);
  recording.close();
  for (TextWriter* file : {&imu, &bias, &truth}) file->close();
  write_trajectory(out / "groundtruth.txt", camera);
  write_truth(out / "truth.yaml", arguments, rig, options, count, motion.duration());
  fmt::print("{} events in {:.2f} s, written to {}\n", count, motion.duration(), out.string());
  return 0;
}

}  // namespace

void add_simulate(CLI::App& app, Action& action) {
  auto a = std::make_shared<SimulateArguments>();
  auto* command = app.add_subcommand("simulate", "Make a recording with exact truth from a scene");
  command->add_option("SCENE", a->scene, "scene file (docs/simulator.md)")->required();
  command->add_option("--out", a->out, "folder for the recording")->required();
  command->add_option("--seed", a->options.seed, "of motion and noise")->capture_default_str();
  command->add_option("--duration", a->motion.duration_s, "[s]")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  command->add_option("--trajectory", a->trajectory,
                      "camera poses to follow instead of the built-in motion (TUM)");
  command->add_flag("--translation", a->motion.translation_only, "hardly rotate");
  command->add_option("--speed", a->motion.speed, "plays the motion faster")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 20.0));
  command->add_option("--still", a->motion.still_s, "rest at the start [s]")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  command->add_option("--amplitude", a->motion.position_m, "of the motion [m]")->capture_default_str();
  command->add_option("--rotation", a->motion.rotation_rad, "of the motion [rad]")->capture_default_str();
  command->add_option("--rig", a->rig, "camera and mounting (Kalibr); default: DAVIS240C of the RPG dataset");
  command->add_option("--imu-rig", a->imu_rig, "IMU noise (Kalibr imu.yaml)");
  command->add_option("--imu-rate", a->imu_rate_hz, "[Hz]")
      ->capture_default_str()
      ->check(CLI::Range(10.0, 20000.0));
  command->add_option("--imu-noise", a->options.imu_noise_scale, "scale of the IMU noise")
      ->capture_default_str();
  command->add_option("--gyro-bias", a->gyro_bias, "x,y,z [rad/s]")->delimiter(',')->expected(3);
  command->add_option("--accel-bias", a->accel_bias, "x,y,z [m/s^2]")->delimiter(',')->expected(3);
  command->add_option("--time-offset", a->time_offset_s, "t_imu = t_camera + offset [s]");
  command->add_option("--background-hz", a->options.background_hz, "noise events per pixel")
      ->capture_default_str();
  command->add_option("--hot-pixels", a->options.hot_pixels, "number of hot pixels")->capture_default_str();
  command->add_option("--drop-events", a->options.drop_share, "share of the events lost")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--dark", a->dark, "FROM TO: no events between these times [s]")->expected(2);
  command->add_flag("--no-noise", a->noiseless, "ideal sensors (biases stay)");
  command->add_flag("--plain", a->plain_text, "events.txt instead of events.txt.zst");
  command->footer("Examples:\n  idol simulate scene.yaml --out recording --duration 10 --seed 3");
  command->callback([&action, a] { action = [a] { return run_simulation(*a); }; });
}

}  // namespace idol::cli
