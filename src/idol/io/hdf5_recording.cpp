#include "idol/io/hdf5_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "idol/io/bag_recording.hpp"
#include "idol/io/choose_stream.hpp"
#include "idol/io/hdf5_sources.hpp"
#include "idol/io/number.hpp"
#include "idol/io/text_recording.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

const Hdf5Layout& layout_of(const Hdf5File& file) {
  using Kind = Hdf5Layout::Kind;
  static const Hdf5Layout kOwn{"HDF5 (idol)", {"events"}, 1,  Kind::kColumns, false, "imu",
                               "accel",       "gyro",     "t"};
  static const Hdf5Layout kM3ed{"HDF5 (M3ED)", {"prophesee/left", "prophesee/right"},
                                1000,          Kind::kColumns,
                                false,         "ovc/imu",
                                "accel",       "omega",
                                "ts"};
  static const Hdf5Layout kDsec{"HDF5 (DSEC)", {"events"}, 1000, Kind::kColumns, true};
  static const Hdf5Layout kTumVie{"HDF5 (TUM-VIE)", {"events"}, 1000};
  static const Hdf5Layout kMvsec{"HDF5 (MVSEC)", {"davis/left", "davis/right"}, 0, Kind::kTable, false,
                                 "davis/left"};
  static const Hdf5Layout kMetavision{"HDF5 (Metavision)", {"CD"}, 1000, Kind::kRecords};
  if (file.has("idol_recording")) return kOwn;
  if (file.has("prophesee")) return kM3ed;
  if (file.has("t_offset")) return kDsec;
  if (file.has("events/t")) return kTumVie;
  if (file.has("davis/left/events") || file.has("davis/right/events")) return kMvsec;
  if (file.has("CD/events")) return kMetavision;
  throw DataError(fmt::format(
      "{}: none of the layouts that are known: idol (idol convert), DSEC (/events, /t_offset), M3ED "
      "(/prophesee), TUM-VIE (/events), MVSEC (/davis) and Metavision (/CD/events)",
      file.name()));
}

/// The file of this name in `folder`, in a folder inside it, or in up to three folders above.
fs::path find_near(fs::path folder, const char* name) {
  std::error_code ignored;
  if (folder.empty()) folder = ".";
  folder = fs::absolute(folder, ignored);
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.is_directory(ignored) && fs::is_regular_file(entry.path() / name, ignored))
      return entry.path() / name;
  for (int up = 0; up <= 3; ++up, folder = folder.parent_path())
    if (fs::is_regular_file(folder / name, ignored)) return folder / name;
  return {};
}

void add_pose(Trajectory& trajectory, Time t, const Pose& pose, const std::string& where) {
  if (!pose.p.allFinite() || !(std::abs(pose.q.norm() - 1.0) <= 0.05))
    throw DataError(fmt::format("{}: the pose is not finite, or its orientation is no rotation", where));
  if (trajectory.empty() || t > trajectory.back().t) trajectory.push_back({t, {pose.q.normalized(), pose.p}});
}

/// Calls `take(i, stamp, values of the columns)` for each row.
template <class Take>
void read_poses(const Hdf5Column& t, std::int64_t ns, const std::vector<Hdf5Column>& columns, Take take) {
  std::vector<std::int64_t> stamps;
  std::vector<std::vector<double>> values(columns.size());
  for (std::uint64_t begin = 0; begin < t.rows(); begin += kHdf5PieceRows) {
    const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(kHdf5PieceRows, t.rows() - begin));
    t.read(begin, count, stamps);
    for (std::size_t c = 0; c < columns.size(); ++c) columns[c].read(begin, count, values[c]);
    for (std::size_t i = 0; i < count; ++i)
      take(hdf5_time(stamps[i], ns), i, values, fmt::format("{}, row {}", t.name(), begin + i));
  }
}

Hdf5Column column_of_width(const Hdf5File& file, const std::string& path, std::uint64_t width) {
  Hdf5Column column = file.column(path);
  if (column.width() != width)
    throw DataError(
        fmt::format("{}: rows of {} numbers where {} are expected", column.name(), column.width(), width));
  return column;
}

Trajectory own_groundtruth(const Hdf5File& file) {
  Trajectory trajectory;
  read_poses(
      column_of_width(file, "groundtruth/t", 1), 1,
      {column_of_width(file, "groundtruth/position", 3), column_of_width(file, "groundtruth/orientation", 4)},
      [&](Time t, std::size_t i, const auto& v, const std::string& where) {
        const double* q = v[1].data() + 4 * i;
        add_pose(trajectory, t, {Quat(q[3], q[0], q[1], q[2]), Vec3(v[0].data() + 3 * i)}, where);
      });
  return trajectory;
}

/// M3ED: the first camera's frame in the present one, 4 x 4.
Trajectory m3ed_groundtruth(const Hdf5File& file) {
  Trajectory trajectory;
  read_poses(column_of_width(file, "ts", 1), 1000, {column_of_width(file, "Cn_T_C0", 16)},
             [&](Time t, std::size_t i, const auto& v, const std::string& where) {
               const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> T(v[0].data() + 16 * i);
               const Mat3 R = T.template topLeftCorner<3, 3>();
               const Vec3 p = T.template topRightCorner<3, 1>();
               if (!R.allFinite() || (R.transpose() * R - Mat3::Identity()).norm() > 0.05)
                 throw DataError(fmt::format("{}: the pose's rotation is none", where));
               add_pose(trajectory, t, Pose{Quat(R).normalized(), p}.inverse(), where);
             });
  return trajectory;
}

}  // namespace

Hdf5Recording::Hdf5Recording(const fs::path& path, StreamChoice choice)
    : path_(path),
      choice_(std::move(choice)),
      file_(std::make_shared<Hdf5File>(path)),
      layout_(layout_of(*file_)) {
  for (const std::string& group : layout_.event_groups)
    if (file_->has(group + (layout_.kind == Hdf5Layout::Kind::kColumns ? "/t" : "/events")))
      groups_.push_back(group);
  if (!layout_.imu_group.empty()) return;
  imu_path_ = find_near(path_.parent_path(), layout_.clock_offset ? "lidar_imu.bag" : "imu_data.txt");
}

std::string Hdf5Recording::format() const { return layout_.name; }

std::string Hdf5Recording::imu_stamps() const {
  return layout_.imu_group + "/" + (layout_.kind == Hdf5Layout::Kind::kTable ? "imu_ts" : layout_.imu_t);
}

bool Hdf5Recording::imu_inside() const { return !layout_.imu_group.empty() && file_->has(imu_stamps()); }

bool Hdf5Recording::has_imu() const { return imu_inside() || !imu_path_.empty(); }

/// M3ED has two cameras; its calibration and truth are of the left one.
std::string Hdf5Recording::event_group() const {
  if (groups_.empty()) throw DataError(fmt::format("{}: holds no events", file_->name()));
  if (choice_.events.empty()) return groups_[0];
  return groups_[*choose_stream(file_->name(), "groups with events", "--events-topic", groups_,
                                choice_.events)];
}

std::unique_ptr<RowSource<Event>> Hdf5Recording::events(Diagnostics& diagnostics) {
  return open_hdf5_events(*file_, event_group(), layout_, diagnostics);
}

std::unique_ptr<RowSource<ImuSample>> Hdf5Recording::imu(Diagnostics& diagnostics) {
  if (imu_inside() && !choice_.imu.empty() && choice_.imu != layout_.imu_group)
    throw UsageError(fmt::format("{}: --imu-topic '{}' is none of the groups with IMU data: {}",
                                 file_->name(), printable(choice_.imu), layout_.imu_group));
  if (imu_inside()) return open_hdf5_imu(*file_, layout_, diagnostics);
  if (imu_path_.extension() == ".bag") return BagRecording(imu_path_, choice_).imu(diagnostics);
  if (!imu_path_.empty()) return open_imu_text(imu_path_, tum_vie_imu_layout());
  throw DataError(fmt::format("{}: holds no IMU data{}", file_->name(),
                              layout_.clock_offset        ? "; put DSEC's lidar_imu.bag beside it"
                              : layout_.imu_group.empty() ? "; put TUM-VIE's imu_data.txt beside it"
                                                          : ""));
}

std::optional<Trajectory> Hdf5Recording::groundtruth() {
  if (file_->has("groundtruth/t")) return own_groundtruth(*file_);
  if (const fs::path poses = m3ed_poses(); !poses.empty()) return m3ed_groundtruth(Hdf5File(poses));
  return std::nullopt;
}

/// M3ED: NAME_data.h5 and NAME_pose_gt.h5.
fs::path Hdf5Recording::m3ed_poses() const {
  const std::string stem = path_.stem().string();
  if (!file_->has("prophesee") || !stem.ends_with("_data")) return {};
  const fs::path poses = path_.parent_path() / (stem.substr(0, stem.size() - 5) + "_pose_gt.h5");
  return fs::exists(poses) ? poses : fs::path();
}

std::vector<fs::path> Hdf5Recording::files() const { return {path_, imu_path_, m3ed_poses()}; }

std::vector<StreamInfo> Hdf5Recording::streams() {
  std::vector<StreamInfo> found;
  const auto add = [&](const std::string& path, const std::string& name, const char* what) {
    if (!file_->has(path)) return;
    try {
      found.push_back({name, what, static_cast<std::int64_t>(file_->column(path).rows())});
    } catch (const DataError&) {
      found.push_back({name, what, -1});
    }
  };
  if (layout_.kind == Hdf5Layout::Kind::kColumns)
    for (const std::string& group : groups_) add(group + "/t", "/" + group, "events");
  else
    for (const std::string& group : groups_) found.push_back({"/" + group + "/events", "events", -1});
  if (imu_inside()) add(imu_stamps(), "/" + layout_.imu_group, "IMU");
  if (!imu_path_.empty()) found.push_back({imu_path_.string(), "IMU", -1});
  add("groundtruth/t", "/groundtruth", "poses");
  return found;
}

Recording::Resolution Hdf5Recording::resolution() {
  std::vector<std::int64_t> size;
  const std::string calibrated = has_events() ? event_group() + "/calib/resolution" : "";
  try {
    if (file_->has("idol_recording")) file_->column("idol_recording").read(1, 2, size);
    if (!calibrated.empty() && file_->has(calibrated)) file_->column(calibrated).read(0, 2, size);
  } catch (const DataError&) {
    return {};  // of no consequence
  }
  constexpr std::int64_t kLargest = 1 << 16;
  if (size.size() != 2 || size[0] <= 0 || size[1] <= 0 || size[0] > kLargest || size[1] > kLargest) return {};
  return {static_cast<int>(size[0]), static_cast<int>(size[1])};
}

}  // namespace idol
