#include "idol/io/hdf5_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "idol/io/bag_recording.hpp"
#include "idol/io/choose_stream.hpp"
#include "idol/io/number.hpp"
#include "idol/io/text_recording.hpp"

namespace idol {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPieceRows = 1 << 16;

const Hdf5Layout& layout_of(const Hdf5File& file) {
  static const Hdf5Layout kOwn{"HDF5 (idol)", {"events"}, 1, false, "imu", "accel", "gyro", "t"};
  static const Hdf5Layout kM3ed{
      "HDF5 (M3ED)", {"prophesee/left", "prophesee/right"}, 1000, false, "ovc/imu", "accel", "omega", "ts"};
  static const Hdf5Layout kDsec{"HDF5 (DSEC)", {"events"}, 1000, true};
  static const Hdf5Layout kTumVie{"HDF5 (TUM-VIE)", {"events"}, 1000};
  if (file.has("idol_recording")) return kOwn;
  if (file.has("prophesee")) return kM3ed;
  if (file.has("t_offset")) return kDsec;
  if (file.has("events/t")) return kTumVie;
  throw DataError(
      fmt::format("{}: none of the layouts that are known: idol (idol convert), DSEC (/events, /t_offset), "
                  "M3ED (/prophesee) "
                  "and TUM-VIE (/events)",
                  file.name()));
}

/// Units of a layout as nanoseconds; what is beyond the range of stamps stays so.
Time scaled(std::int64_t t, std::int64_t ns) {
  constexpr Time kBeyond = kLargestStamp + 1;
  if (t > kLargestStamp / ns) return kBeyond;
  if (t < -(kLargestStamp / ns)) return -kBeyond;
  return t * ns;
}

/// Rows from several columns of equal length, piece by piece.
template <class Row>
class Hdf5Source : public RowSource<Row> {
 public:
  std::span<const Row> read() override {
    rows_.clear();
    while (rows_.empty() && next_ < count_) {
      begin_ = next_;
      next_ += std::min<std::uint64_t>(kPieceRows, count_ - next_);
      fill(begin_, static_cast<std::size_t>(next_ - begin_), rows_);
    }
    return rows_;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string where(std::size_t i) const override {
    return fmt::format("{}, row {}", name_, begin_ + i);
  }
  [[nodiscard]] double progress() const override {
    return count_ > 0 ? static_cast<double>(next_) / static_cast<double>(count_) : 1.0;
  }

 protected:
  explicit Hdf5Source(std::string name) : name_(std::move(name)) {}
  /// To be called for each column. Throws DataError for rows of another width.
  void check(const Hdf5Column& column, std::uint64_t width, Diagnostics& diagnostics) {
    if (column.width() != width)
      throw DataError(
          fmt::format("{}: rows of {} numbers where {} are expected", column.name(), column.width(), width));
    if (any_ && column.rows() != count_)
      diagnostics.warn("unequal_columns", fmt::format("{}: {} rows, others have {}; what all have is read",
                                                      column.name(), column.rows(), count_));
    count_ = any_ ? std::min(count_, column.rows()) : column.rows();
    any_ = true;
  }
  virtual void fill(std::uint64_t begin, std::size_t count, std::vector<Row>& rows) = 0;

 private:
  std::string name_;
  bool any_ = false;
  std::uint64_t count_ = 0, begin_ = 0, next_ = 0;
  std::vector<Row> rows_;
};

class EventSource : public Hdf5Source<Event> {
 public:
  EventSource(const Hdf5File& file, const std::string& group, const Hdf5Layout& layout,
              Diagnostics& diagnostics)
      : Hdf5Source(fmt::format("{}: /{}", file.name(), group)),
        t_(file.column(group + "/t")),
        x_(file.column(group + "/x")),
        y_(file.column(group + "/y")),
        p_(file.column(group + "/p")),
        ns_(layout.ns) {
    for (const Hdf5Column* column : {&t_, &x_, &y_, &p_}) check(*column, 1, diagnostics);
    if (!layout.clock_offset) return;
    file.column("t_offset").read(0, 1, stamps_);
    offset_ = scaled(stamps_[0], ns_);
  }

 protected:
  void fill(std::uint64_t begin, std::size_t count, std::vector<Event>& rows) override {
    t_.read(begin, count, stamps_);
    x_.read(begin, count, xs_);
    y_.read(begin, count, ys_);
    p_.read(begin, count, ps_);
    rows.resize(count);
    const std::int64_t ns = ns_;  // outside the loop: it cannot change there, and the division is slow
    const Time offset = offset_;
    const std::int64_t* t = stamps_.data();
    const std::uint16_t *x = xs_.data(), *y = ys_.data();
    const std::int8_t* p = ps_.data();
    for (std::size_t i = 0; i < count; ++i) rows[i] = {scaled(t[i], ns) + offset, x[i], y[i], p[i] > 0};
  }

 private:
  Hdf5Column t_, x_, y_, p_;
  std::int64_t ns_;
  Time offset_ = 0;
  std::vector<std::int64_t> stamps_;
  std::vector<std::uint16_t> xs_, ys_;
  std::vector<std::int8_t> ps_;
};

class ImuSource : public Hdf5Source<ImuSample> {
 public:
  ImuSource(const Hdf5File& file, const Hdf5Layout& layout, Diagnostics& diagnostics)
      : Hdf5Source(fmt::format("{}: /{}", file.name(), layout.imu_group)),
        t_(file.column(layout.imu_group + "/" + layout.imu_t)),
        accel_(file.column(layout.imu_group + "/" + layout.accel)),
        gyro_(file.column(layout.imu_group + "/" + layout.gyro)),
        ns_(layout.ns) {
    check(t_, 1, diagnostics);
    for (const Hdf5Column* column : {&accel_, &gyro_}) check(*column, 3, diagnostics);
  }

 protected:
  /// M3ED marks samples that were lost: all three readings are NaN there.
  void fill(std::uint64_t begin, std::size_t count, std::vector<ImuSample>& rows) override {
    t_.read(begin, count, stamps_);
    accel_.read(begin, count, accels_);
    gyro_.read(begin, count, gyros_);
    for (std::size_t i = 0; i < count; ++i) {
      const ImuSample sample{scaled(stamps_[i], ns_), Vec3(accels_.data() + 3 * i),
                             Vec3(gyros_.data() + 3 * i)};
      if (!(sample.accel.array().isNaN().all() && sample.gyro.array().isNaN().all())) rows.push_back(sample);
    }
  }

 private:
  Hdf5Column t_, accel_, gyro_;
  std::int64_t ns_;
  std::vector<std::int64_t> stamps_;
  std::vector<double> accels_, gyros_;
};

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
  for (std::uint64_t begin = 0; begin < t.rows(); begin += kPieceRows) {
    const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(kPieceRows, t.rows() - begin));
    t.read(begin, count, stamps);
    for (std::size_t c = 0; c < columns.size(); ++c) columns[c].read(begin, count, values[c]);
    for (std::size_t i = 0; i < count; ++i)
      take(scaled(stamps[i], ns), i, values, fmt::format("{}, row {}", t.name(), begin + i));
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
    if (file_->has(group + "/t")) groups_.push_back(group);
  if (!layout_.imu_group.empty()) return;
  imu_path_ = find_near(path_.parent_path(), layout_.clock_offset ? "lidar_imu.bag" : "imu_data.txt");
}

std::string Hdf5Recording::format() const { return layout_.name; }

bool Hdf5Recording::imu_inside() const {
  return !layout_.imu_group.empty() && file_->has(layout_.imu_group + "/" + layout_.imu_t);
}

bool Hdf5Recording::has_imu() const { return imu_inside() || !imu_path_.empty(); }

/// M3ED has two cameras; its calibration and truth are of the left one.
std::string Hdf5Recording::event_group() const {
  if (groups_.empty()) throw DataError(fmt::format("{}: holds no events", file_->name()));
  if (choice_.events.empty()) return groups_[0];
  return groups_[*choose_stream(file_->name(), "groups with events", "--events-topic", groups_,
                                choice_.events)];
}

std::unique_ptr<RowSource<Event>> Hdf5Recording::events(Diagnostics& diagnostics) {
  return std::make_unique<EventSource>(*file_, event_group(), layout_, diagnostics);
}

std::unique_ptr<RowSource<ImuSample>> Hdf5Recording::imu(Diagnostics& diagnostics) {
  if (imu_inside()) return std::make_unique<ImuSource>(*file_, layout_, diagnostics);
  if (imu_path_.extension() == ".bag") return BagRecording(imu_path_, choice_).imu(diagnostics);
  if (!imu_path_.empty()) return open_imu_text(imu_path_, kTumVieImu);
  throw DataError(fmt::format("{}: holds no IMU data{}", file_->name(),
                              layout_.clock_offset        ? "; put DSEC's lidar_imu.bag beside it"
                              : layout_.imu_group.empty() ? "; put TUM-VIE's imu_data.txt beside it"
                                                          : ""));
}

std::optional<Trajectory> Hdf5Recording::groundtruth() {
  if (file_->has("groundtruth/t")) return own_groundtruth(*file_);
  // M3ED: NAME_data.h5 and NAME_pose_gt.h5.
  std::string stem = path_.stem().string();
  if (file_->has("prophesee") && stem.ends_with("_data")) {
    const fs::path poses = path_.parent_path() / (stem.substr(0, stem.size() - 5) + "_pose_gt.h5");
    if (fs::exists(poses)) return m3ed_groundtruth(Hdf5File(poses));
  }
  return std::nullopt;
}

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
  for (const std::string& group : groups_) add(group + "/t", "/" + group, "events");
  if (imu_inside()) add(layout_.imu_group + "/" + layout_.imu_t, "/" + layout_.imu_group, "IMU");
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
