#include "idol/io/hdf5_sources.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "idol/io/number.hpp"

namespace idol {

namespace {

constexpr Time kBeyond = kLargestStamp + 1;

/// Seconds as nanoseconds; what is beyond the range of stamps stays so.
Time time_of(double seconds) {
  const double ns = seconds * kNsPerS;
  return std::abs(ns) <= static_cast<double>(kLargestStamp) ? static_cast<Time>(std::llround(ns)) : kBeyond;
}

/// Stamps are whole numbers of micro- or nanoseconds, perhaps stored as decimal ones. Seconds step by far
/// less than one.
void check_whole_units(const Hdf5Column& stamps) {
  if (!stamps.is_float() || stamps.rows() < 2) return;
  std::vector<double> values;
  stamps.read(0, static_cast<std::size_t>(std::min<std::uint64_t>(kHdf5PieceRows, stamps.rows())), values);
  const auto fraction =
      std::find_if(values.begin(), values.end(), [](double v) { return v != std::floor(v); });
  if (fraction == values.end() || values.back() - values.front() >= static_cast<double>(values.size()))
    return;
  throw DataError(
      fmt::format("{}: stamps are decimal numbers like {:.9g}, of which neighbours differ by less than one: "
                  "seconds? Whole "
                  "microseconds are expected; multiply by 1e6",
                  stamps.name(), *fraction));
}

/// Rows from several columns of equal length, piece by piece.
template <class Row>
class Hdf5Source : public RowSource<Row> {
 public:
  std::span<const Row> read() override {
    rows_.clear();
    while (rows_.empty() && next_ < count_) {
      begin_ = next_;
      next_ += std::min<std::uint64_t>(kHdf5PieceRows, count_ - next_);
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
        t_(column(file, group, layout, "t")),
        x_(column(file, group, layout, "x")),
        y_(column(file, group, layout, "y")),
        p_(column(file, group, layout, "p")),
        ns_(layout.ns) {
    for (const Hdf5Column* column : {&t_, &x_, &y_, &p_}) check(*column, 1, diagnostics);
    check_whole_units(t_);
    if (!layout.clock_offset) return;
    file.column("t_offset").read(0, 1, stamps_);
    offset_ = hdf5_time(stamps_[0], ns_);
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
    for (std::size_t i = 0; i < count; ++i) rows[i] = {hdf5_time(t[i], ns) + offset, x[i], y[i], p[i] > 0};
  }

 private:
  static Hdf5Column column(const Hdf5File& file, const std::string& group, const Hdf5Layout& layout,
                           const char* name) {
    if (layout.kind == Hdf5Layout::Kind::kRecords) return file.column(group + "/events", name);
    return file.column(group + "/" + name);
  }

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
    check_whole_units(t_);
  }

 protected:
  /// M3ED marks samples that were lost: all three readings are NaN there.
  void fill(std::uint64_t begin, std::size_t count, std::vector<ImuSample>& rows) override {
    t_.read(begin, count, stamps_);
    accel_.read(begin, count, accels_);
    gyro_.read(begin, count, gyros_);
    for (std::size_t i = 0; i < count; ++i) {
      const ImuSample sample{hdf5_time(stamps_[i], ns_), Vec3(accels_.data() + 3 * i),
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

/// MVSEC's events: rows of x, y, t [s] and polarity.
class TableEventSource : public Hdf5Source<Event> {
 public:
  TableEventSource(const Hdf5File& file, const std::string& group, Diagnostics& diagnostics)
      : Hdf5Source(fmt::format("{}: /{}", file.name(), group)), table_(file.column(group + "/events")) {
    check(table_, kWidth, diagnostics);
  }

 protected:
  void fill(std::uint64_t begin, std::size_t count, std::vector<Event>& rows) override {
    table_.read(begin, count, values_);
    rows.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const double* v = values_.data() + kWidth * i;
      rows[i] = {time_of(v[2]), pixel(v[0]), pixel(v[1]), v[3] > 0};
    }
  }

 private:
  static constexpr std::size_t kWidth = 4;
  static std::uint16_t pixel(double v) {
    constexpr double kLargest = 0xffff;
    return static_cast<std::uint16_t>(
        v >= 0 && v <= kLargest ? v : kLargest);  // beyond any sensor: refused later
  }

  Hdf5Column table_;
  std::vector<double> values_;
};

/// MVSEC's IMU: rows of accelerations and rates beside stamps [s].
class TableImuSource : public Hdf5Source<ImuSample> {
 public:
  TableImuSource(const Hdf5File& file, const std::string& group, Diagnostics& diagnostics)
      : Hdf5Source(fmt::format("{}: /{}/imu", file.name(), group)),
        t_(file.column(group + "/imu_ts")),
        table_(file.column(group + "/imu")) {
    check(t_, 1, diagnostics);
    check(table_, kWidth, diagnostics);
  }

 protected:
  void fill(std::uint64_t begin, std::size_t count, std::vector<ImuSample>& rows) override {
    t_.read(begin, count, stamps_);
    table_.read(begin, count, values_);
    for (std::size_t i = 0; i < count; ++i)
      rows.push_back(
          {time_of(stamps_[i]), Vec3(values_.data() + kWidth * i), Vec3(values_.data() + kWidth * i + 3)});
  }

 private:
  static constexpr std::size_t kWidth = 6;
  Hdf5Column t_, table_;
  std::vector<double> stamps_, values_;
};

}  // namespace

Time hdf5_time(std::int64_t t, std::int64_t ns) {
  if (t > kLargestStamp / ns) return kBeyond;
  if (t < -(kLargestStamp / ns)) return -kBeyond;
  return t * ns;
}

std::unique_ptr<RowSource<Event>> open_hdf5_events(const Hdf5File& file, const std::string& group,
                                                   const Hdf5Layout& layout, Diagnostics& diagnostics) {
  if (layout.kind == Hdf5Layout::Kind::kTable)
    return std::make_unique<TableEventSource>(file, group, diagnostics);
  return std::make_unique<EventSource>(file, group, layout, diagnostics);
}

std::unique_ptr<RowSource<ImuSample>> open_hdf5_imu(const Hdf5File& file, const Hdf5Layout& layout,
                                                    Diagnostics& diagnostics) {
  if (layout.kind == Hdf5Layout::Kind::kTable)
    return std::make_unique<TableImuSource>(file, layout.imu_group, diagnostics);
  return std::make_unique<ImuSource>(file, layout, diagnostics);
}

}  // namespace idol
