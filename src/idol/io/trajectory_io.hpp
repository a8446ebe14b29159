// Trajectories as text (TUM: t tx ty tz qx qy qz qw) and lines as CSV and PLY.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include "idol/base/types.hpp"

namespace idol {

/// Reads a TUM trajectory; '#' starts a comment, stamps must increase. Throws DataError with file and line.
/// EuRoC's and TUM-VI's layouts too, which a first line beginning with '#timestamp,' tells.
Trajectory read_trajectory(const std::filesystem::path& path);

/// Ground truth as motion captures leave it.
struct TruthFile {
  Trajectory poses;
  std::int64_t lost = 0;        ///< rows of zeros or of no numbers, left out: the capture had lost the body
  bool has_orientation = true;  ///< false: rows `t px py pz`; the quaternions are NaN
};
TruthFile read_truth(const std::filesystem::path& path);

/// Writers throw DataError when the disk refuses.
void write_trajectory(const std::filesystem::path& path, std::span<const StampedPose> trajectory);
/// states.csv: t,px,py,pz,vx,vy,vz,qx,qy,qz,qw,bgx,bgy,bgz,bax,bay,baz
void write_states(const std::filesystem::path& path, std::span<const NavState> states);
std::vector<NavState> read_states(const std::filesystem::path& path);
/// lines.csv: id,ax,ay,az,bx,by,bz,first_s,last_s,windows,events; times in seconds of the recording's clock.
void write_lines_csv(const std::filesystem::path& path, std::span<const Line> lines);
std::vector<Line> read_lines_csv(const std::filesystem::path& path);
void write_lines_ply(const std::filesystem::path& path, std::span<const Line> lines);

/// A stamp as decimal seconds with nine digits, exactly.
std::string format_stamp(Time t);

}  // namespace idol
