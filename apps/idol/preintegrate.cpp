#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "arguments.hpp"
#include "commands.hpp"
#include "idol/base/calibration_files.hpp"
#include "idol/imu/preintegration.hpp"
#include "idol/io/imu_stream.hpp"
#include "idol/io/table.hpp"
#include "idol/io/text_recording.hpp"
#include "idol/io/trajectory_io.hpp"
#include "standard_input.hpp"

namespace idol::cli {
namespace {

struct PreintegrateArguments {
  std::filesystem::path imu, at, imu_rig;
  std::string from, method;
  std::vector<double> gyro_bias, accel_bias;
  bool covariance = false;
};

std::vector<ImuSample> read_imu(const std::filesystem::path& path, Diagnostics& diagnostics) {
  ImuStream stream(open_imu_text(path, find_imu_layout(path, diagnostics)), {}, diagnostics);
  std::vector<ImuSample> samples;
  for (ImuSample sample; stream.next(sample);) samples.push_back(sample);
  if (samples.size() < 2)
    throw DataError(fmt::format("{}: {} IMU samples (t ax ay az gx gy gz): at least two are needed",
                                path.string(), samples.size()));
  return samples;
}

std::vector<Time> read_times(const std::filesystem::path& path) {
  std::vector<Time> times;
  read_table(path, "t", [&](const TableRow& row) { times.push_back(row.stamp(0)); });
  if (times.empty())
    throw DataError(fmt::format("{}: holds no times; one stamp a line is expected", path.string()));
  return times;
}

ImuNoise read_noise(const std::filesystem::path& path) {
  if (path.empty()) return {};
  const auto noise = read_calibration_file(path).imu;
  if (!noise)
    throw DataError(
        fmt::format("{}:1: no IMU noise in this file (accelerometer_noise_density and the other keys of "
                    "Kalibr's imu.yaml)",
                    path.string()));
  return *noise;
}

Time parse_from(const std::string& text) {
  const auto t = parse_stamp(text);
  if (!t) throw UsageError(fmt::format("--from {}: not a stamp in seconds", printable(text)));
  return *t;
}

PreintegrationOptions make_options(const PreintegrateArguments& arguments) {
  PreintegrationOptions options;
  std::vector<OptionField> fields;
  list_fields(options, fields);
  if (!arguments.method.empty()) set_option(fields, "method", arguments.method, "--method");
  return options;
}

ImuBias make_bias(const PreintegrateArguments& arguments) {
  ImuBias bias;
  if (!arguments.gyro_bias.empty()) bias.gyro = Vec3(arguments.gyro_bias.data());
  if (!arguments.accel_bias.empty()) bias.accel = Vec3(arguments.accel_bias.data());
  return bias;
}

std::string format_motion(Time t, const Motion& motion) {
  Quat q = Quat(motion.dR).normalized();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Vec3 &v = motion.dv, &p = motion.dp;
  return fmt::format("{} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f} {:.12f}",
                     format_stamp(t), q.x(), q.y(), q.z(), q.w(), v.x(), v.y(), v.z(), p.x(), p.y(), p.z());
}

// The upper triangle, row by row, in the order rotation, velocity, position; the library has (position,
// rotation, velocity).
std::string format_covariance(const Mat9& covariance) {
  std::string out;
  for (int i = 0; i < 9; ++i)
    for (int j = i; j < 9; ++j) out += fmt::format(" {:.12e}", covariance((i + 3) % 9, (j + 3) % 9));
  return out;
}

void warn_of_quality(const SampleQuality& quality, const std::string& file, Diagnostics& diagnostics) {
  if (quality.gaps > 0)
    diagnostics.warn(
        "gaps",
        fmt::format("{}: no data for up to {:.3f} s: the motion there is a guess, and the covariance "
                    "is inflated",
                    file, quality.longest_gap_s),
        quality.gaps);
  if (quality.merged > 0)
    diagnostics.warn(
        "merged",
        fmt::format("{}: stamps less than a quarter of the period apart: such samples are averaged", file),
        quality.merged);
  if (quality.saturated > 0)
    diagnostics.warn("saturated",
                     fmt::format("{}: readings at the sensor's range: the motion there is cut short, and the "
                                 "covariance is inflated",
                                 file),
                     quality.saturated);
}

int run_preintegration(PreintegrateArguments arguments) {
  arguments.imu = input_path(arguments.imu);
  arguments.at = input_path(arguments.at);
  const Time from = parse_from(arguments.from);
  const PreintegrationOptions options = make_options(arguments);
  const ImuBias bias = make_bias(arguments);
  const ImuNoise noise = read_noise(arguments.imu_rig);
  Diagnostics diagnostics;
  const std::vector<ImuSample> samples = read_imu(arguments.imu, diagnostics);
  const std::vector<Time> times = read_times(arguments.at);
  const Time first = samples.front().t, last = samples.back().t;
  const auto outside = [&](const char* what, Time t) {
    return DataError(fmt::format("{}: {} {} lies outside the data, which span {} to {}",
                                 arguments.imu.string(), what, format_stamp(t), format_stamp(first),
                                 format_stamp(last)));
  };
  if (from < first || from > last) throw outside("--from", from);

  const auto [earliest, latest] = std::minmax_element(times.begin(), times.end());
  const auto window = [&](Time begin, Time end) {
    // Two margins: readings beyond the one that ends a window still shape it.
    const auto before = std::lower_bound(samples.begin(), samples.end(), std::clamp(begin, first, last),
                                         [](const ImuSample& s, Time t) { return s.t < t; });
    const auto after = std::upper_bound(before, samples.end(), std::clamp(end, first, last),
                                        [](Time t, const ImuSample& s) { return t < s.t; });
    const std::ptrdiff_t margin = std::ptrdiff_t{2} * options.margin_samples;
    return std::span(before - std::min(margin, before - samples.begin()),
                     after + std::min(margin, samples.end() - after));
  };
  const Time end = std::clamp(*latest, from, last);
  const Preintegration imu(window(std::min(*earliest, from), end), from, end, bias, noise, options);
  warn_of_quality(imu.quality(), arguments.imu.string(), diagnostics);
  print_warnings(diagnostics);
  for (const Time t : times) {
    if (t < first || t > last) {
      std::fflush(stdout);
      throw outside("time", t);
    }
    const Motion motion = imu.motion(t);
    std::string row = format_motion(t, motion);
    if (arguments.covariance && t >= from) row += format_covariance(imu.covariance(t));
    if (arguments.covariance && t < from) {
      const Preintegration back(window(t, from), t, from, bias, noise, options);
      row += format_covariance(inverse_covariance(back.motion(from), back.covariance(from)));
    }
    fmt::print("{}\n", row);
  }
  return 0;
}

}  // namespace

void add_preintegrate(CLI::App& app, Action& action) {
  auto a = std::make_shared<PreintegrateArguments>();
  auto* command = app.add_subcommand("preintegrate", "Integrate an IMU file from one time to others");
  command->add_option("--imu", a->imu, "IMU file: t ax ay az gx gy gz")->required();
  command->add_option("--from", a->from, "stamp of the file at which the motion starts [s]")->required();
  command->add_option("--at", a->at, "file of stamps, one a line")->required();
  command->add_option("--imu-rig", a->imu_rig, "IMU noise (Kalibr imu.yaml); default: an MPU-6150");
  command
      ->add_option("--method", a->method, "signals between the samples: gpm, lpm or continuous (the default)")
      ->check(CLI::IsMember(
          std::vector<std::string>(kPreintegrationMethods.begin(), kPreintegrationMethods.end())));
  command->add_option("--gyro-bias", a->gyro_bias, "x,y,z [rad/s], taken off the readings")
      ->delimiter(',')
      ->expected(3);
  command->add_option("--accel-bias", a->accel_bias, "x,y,z [m/s^2], taken off the readings")
      ->delimiter(',')
      ->expected(3);
  command->add_flag("--covariance", a->covariance,
                    "append the upper triangle of the covariance of (rotation, velocity, "
                    "position)");
  command->footer("Examples:\n  idol preintegrate imu.txt --from 12.5 --at times.txt --method continuous");
  command->callback([&action, a] { action = [a] { return run_preintegration(*a); }; });
}

}  // namespace idol::cli
