#include "idol/io/trajectory_io.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string>
#include <string_view>

#include "idol/base/diagnostics.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/table.hpp"
#include "idol/io/text_writer.hpp"

namespace idol {
namespace {

constexpr const char* kTumHeader = "t tx ty tz qx qy qz qw";
// EuRoC's state_groundtruth_estimate0/data.csv; stamps in ns.
constexpr const char* kAslHeader = "t,px,py,pz,qw,qx,qy,qz,vx,vy,vz,bwx,bwy,bwz,bax,bay,baz";
constexpr const char* kStatesHeader = "t,px,py,pz,vx,vy,vz,qx,qy,qz,qw,bgx,bgy,bgz,bax,bay,baz";

Quat checked_quaternion(const TableRow& row, const Quat& q, const char* columns) {
  constexpr double kTolerance =
      0.05;  // rounding leaves 1e-3 at most; beyond it the columns mean something else
  if (std::abs(q.norm() - 1.0) > kTolerance) {
    row.refuse(fmt::format("the quaternion ({}) has length {:.3g}, not 1; are the columns in this order?",
                           columns, q.norm()));
  }
  return q.normalized();
}

Quat read_quaternion(const TableRow& row, std::size_t i) {
  return checked_quaternion(row, Quat(row.number(i + 3), row.number(i), row.number(i + 1), row.number(i + 2)),
                            "qx qy qz qw");
}

Quat read_asl_quaternion(const TableRow& row) {
  return checked_quaternion(row, Quat(row.number(4), row.number(5), row.number(6), row.number(7)),
                            "qw qx qy qz");
}

/// Whether the first line is of EuRoC's truth: "#timestamp, p_RS_R_x [m], ...".
bool is_asl(const std::filesystem::path& path) {
  LineReader lines(path);
  std::string_view first;
  return lines.next(first) && first.starts_with("#timestamp") && first.find(',') != std::string_view::npos;
}

void append(fmt::memory_buffer& out, const char* format, const Vec3& v) {
  fmt::format_to(std::back_inserter(out), fmt::runtime(format), v.x(), v.y(), v.z());
}

void check_order(const TableRow& row, Time t, Time previous) {
  if (t < previous)
    row.refuse(fmt::format("stamp {} comes after {}; sort the file by time", format_stamp(t),
                           format_stamp(previous)));
}

}  // namespace

std::string format_stamp(Time t) {
  const std::uint64_t magnitude = t < 0 ? 0 - static_cast<std::uint64_t>(t) : static_cast<std::uint64_t>(t);
  constexpr std::uint64_t kSecond = 1'000'000'000;
  return fmt::format("{}{}.{:09}", t < 0 ? "-" : "", magnitude / kSecond, magnitude % kSecond);
}

Trajectory read_trajectory(const std::filesystem::path& path) {
  const bool asl = is_asl(path);
  const char* header = asl ? kAslHeader : kTumHeader;
  Trajectory trajectory;
  read_table(path, header, [&](const TableRow& row) {
    const StampedPose pose = asl ? StampedPose{row.integer(0), {read_asl_quaternion(row), row.vec3(1)}}
                                 : StampedPose{row.stamp(0), {read_quaternion(row, 4), row.vec3(1)}};
    if (!trajectory.empty()) {
      check_order(row, pose.t, trajectory.back().t);
      if (pose.t == trajectory.back().t) return;
    }
    trajectory.push_back(pose);
  });
  if (trajectory.empty()) throw DataError(fmt::format("{}: holds no poses ({})", path.string(), header));
  return trajectory;
}

void write_trajectory(const std::filesystem::path& path, std::span<const StampedPose> trajectory) {
  TextWriter file(path);
  file.write(fmt::format("# {}\n", kTumHeader));
  for (const auto& [t, T] : trajectory) {
    file.write(fmt::format("{} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}\n", format_stamp(t), T.p.x(),
                           T.p.y(), T.p.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w()));
  }
  file.close();
}

void write_states(const std::filesystem::path& path, std::span<const NavState> states) {
  TextWriter file(path);
  file.write(fmt::format("{}\n", kStatesHeader));
  fmt::memory_buffer line;
  for (const NavState& state : states) {
    const Quat& q = state.T_w_i.q;
    line.clear();
    fmt::format_to(std::back_inserter(line), "{}", format_stamp(state.t));
    append(line, ",{:.9f},{:.9f},{:.9f}", state.T_w_i.p);
    append(line, ",{:.9f},{:.9f},{:.9f}", state.v_w);
    append(line, ",{:.12f},{:.12f},{:.12f}", q.vec());
    fmt::format_to(std::back_inserter(line), ",{:.12f}", q.w());
    append(line, ",{:.12g},{:.12g},{:.12g}", state.bias.gyro);
    append(line, ",{:.12g},{:.12g},{:.12g}\n", state.bias.accel);
    file.write({line.data(), line.size()});
  }
  file.close();
}

std::vector<NavState> read_states(const std::filesystem::path& path) {
  std::vector<NavState> states;
  read_table(path, kStatesHeader, [&](const TableRow& row) {
    NavState state;
    state.t = row.stamp(0);
    state.T_w_i = {read_quaternion(row, 7), row.vec3(1)};
    state.v_w = row.vec3(4);
    state.bias = {row.vec3(11), row.vec3(14)};
    if (!states.empty()) check_order(row, state.t, states.back().t);
    states.push_back(state);
  });
  return states;
}

}  // namespace idol
