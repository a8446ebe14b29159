#include "idol/io/trajectory_io.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>

#include "idol/base/diagnostics.hpp"
#include "idol/io/line_reader.hpp"
#include "idol/io/number.hpp"
#include "idol/io/table.hpp"
#include "idol/io/text_layout.hpp"
#include "idol/io/text_writer.hpp"

namespace idol {
namespace {

constexpr const char* kTumHeader = "t tx ty tz qx qy qz qw";
// EuRoC's state_groundtruth_estimate0/data.csv; stamps in ns.
constexpr const char* kAslHeader = "t,px,py,pz,qw,qx,qy,qz,vx,vy,vz,bwx,bwy,bwz,bax,bay,baz";
// TUM-VI's mocap0/data.csv.
constexpr const char* kAslPoseHeader = "t,px,py,pz,qw,qx,qy,qz";
constexpr std::string_view kPositionHeader = "t px py pz";
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

void check_order(const TableRow& row, Time t, Time previous) {
  if (t < previous)
    row.refuse(fmt::format("stamp {} comes after {}; sort the file by time", format_stamp(t),
                           format_stamp(previous)));
}

/// What the beginning of a trajectory file says of its columns.
struct TrajectoryLayout {
  bool asl = false;  // "#timestamp, p_RS_R_x [m], ...": EuRoC's and TUM-VI's, stamps in ns
  std::size_t columns = 0;
};

TrajectoryLayout layout_of(const std::filesystem::path& path) {
  LineReader lines(path);
  std::string_view line;
  TrajectoryLayout layout;
  if (!lines.next(line)) return layout;
  layout.asl = line.starts_with("#timestamp") && line.find(',') != std::string_view::npos;
  do {
    if (!is_blank_or_comment(line)) {
      layout.columns = split_columns(line, {});
      break;
    }
  } while (lines.next(line));
  return layout;
}

const char* header_of(const TrajectoryLayout& layout, bool positions) {
  if (layout.asl) return layout.columns == 8 ? kAslPoseHeader : kAslHeader;
  return positions && layout.columns == 4 ? kPositionHeader.data() : kTumHeader;
}

/// Where a motion capture lost its body it writes zeros, or no numbers at all.
bool is_lost(const TableRow& row, std::size_t begin, std::size_t end) {
  bool finite = true, zero = true;
  for (std::size_t i = begin; i < end; ++i) {
    const auto value = row.any_number(i);
    finite = finite && std::isfinite(value);
    zero = zero && value == 0;
  }
  return !finite || zero;
}

/// Stamps that are whole numbers and far apart are of another unit.
void check_unit(const std::filesystem::path& path, const Trajectory& poses) {
  if (poses.size() < 3) return;
  constexpr Time kSecond = 1'000'000'000;
  if (std::any_of(poses.begin(), poses.end(), [](const StampedPose& p) { return p.t % kSecond != 0; }))
    return;
  const double step =
      seconds_between(poses.front().t, poses.back().t) / static_cast<double>(poses.size() - 1);
  constexpr double kSlowest = 1000;
  if (step < kSlowest) return;
  const std::int64_t unit = unit_of_stamps(step, 2e-4, 0.2);  // 5 Hz to 5 kHz
  throw DataError(fmt::format(
      "{}: the stamps are whole numbers that step by {:.6g}: these are no seconds{}; write seconds",
      path.string(), step, unit > 0 ? fmt::format(" but {}", unit_name(unit)) : ""));
}

TruthFile read_poses(const std::filesystem::path& path, bool lenient) {
  const TrajectoryLayout layout = layout_of(path);
  const std::string header = header_of(layout, lenient);
  TruthFile file;
  file.has_orientation = header != kPositionHeader;
  read_table(path, header, [&](const TableRow& row) {
    const Time t = layout.asl ? row.integer(0) : row.stamp(0);
    if (lenient && file.has_orientation && is_lost(row, 4, 8)) return static_cast<void>(++file.lost);
    if (lenient && !file.has_orientation && !std::isfinite(row.any_number(1)))
      return static_cast<void>(++file.lost);
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    const Quat q = !file.has_orientation ? Quat(kNone, kNone, kNone, kNone)
                   : layout.asl          ? read_asl_quaternion(row)
                                         : read_quaternion(row, 4);
    if (!file.poses.empty()) {
      check_order(row, t, file.poses.back().t);
      if (t == file.poses.back().t) return;
    }
    file.poses.push_back({t, {q, row.vec3(1)}});
  });
  if (file.poses.empty())
    throw DataError(file.lost > 0 ? fmt::format("{}: all {} poses are lost ones: zeros, or no numbers",
                                                path.string(), file.lost)
                                  : fmt::format("{}: holds no poses ({})", path.string(), header));
  if (!layout.asl) check_unit(path, file.poses);
  return file;
}

void append(fmt::memory_buffer& out, const char* format, const Vec3& v) {
  fmt::format_to(std::back_inserter(out), fmt::runtime(format), v.x(), v.y(), v.z());
}

}  // namespace

std::string format_stamp(Time t) {
  const std::uint64_t magnitude = t < 0 ? 0 - static_cast<std::uint64_t>(t) : static_cast<std::uint64_t>(t);
  constexpr std::uint64_t kSecond = 1'000'000'000;
  return fmt::format("{}{}.{:09}", t < 0 ? "-" : "", magnitude / kSecond, magnitude % kSecond);
}

Trajectory read_trajectory(const std::filesystem::path& path) { return read_poses(path, false).poses; }

TruthFile read_truth(const std::filesystem::path& path) { return read_poses(path, true); }

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
