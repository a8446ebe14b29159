#include <blosc.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <hdf5.h>

#include <array>
#include <limits>

#include "idol/base/diagnostics.hpp"
#include "idol/io/hdf5_file.hpp"
#include "idol/io/hdf5_writer.hpp"
#include "recording_util.hpp"
#include "test_util.hpp"

namespace idol::test {
namespace {

namespace fs = std::filesystem;

enum class Filter { kNone, kZlib, kBlosc };

/// Writes files as other programs do.
class Hdf5Maker {
 public:
  explicit Hdf5Maker(const fs::path& path)
      : file_(own_hdf5(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT))) {}

  template <class T>
  void column(const std::string& path, Hdf5Id type, const std::vector<T>& values, std::vector<hsize_t> size,
              Filter filter = Filter::kNone) {
    const auto links = own_hdf5(H5Pcreate(H5P_LINK_CREATE)),
               creation = own_hdf5(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_create_intermediate_group(*links, 1);
    const int rank = static_cast<int>(size.size());
    const auto space = own_hdf5(H5Screate_simple(rank, size.data(), nullptr));
    if (filter != Filter::kNone) H5Pset_chunk(*creation, rank, size.data());
    if (filter == Filter::kZlib) H5Pset_deflate(*creation, 1);
    // The library would not create a data set with a filter that it does not know.
    constexpr H5Z_filter_t kBlosc = 32001;
    const H5Z_class2_t writing{H5Z_CLASS_T_VERS, kBlosc, 1, 1, "blosc", nullptr, nullptr, pass_on};
    if (filter == Filter::kBlosc) H5Zregister(&writing);
    if (filter == Filter::kBlosc) H5Pset_filter(*creation, kBlosc, H5Z_FLAG_OPTIONAL, 0, nullptr);
    const auto data =
        own_hdf5(H5Dcreate2(*file_, path.c_str(), type, *space, *links, *creation, H5P_DEFAULT));
    ASSERT_TRUE(data) << path;
    if (filter != Filter::kBlosc) {
      ASSERT_GE(H5Dwrite(*data, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
      return;
    }
    std::vector<char> packed(values.size() * sizeof(T) + BLOSC_MAX_OVERHEAD);
    const int bytes =
        blosc_compress_ctx(5, BLOSC_SHUFFLE, sizeof(T), values.size() * sizeof(T), values.data(),
                           packed.data(), packed.size(), BLOSC_ZSTD_COMPNAME, 0, 1);
    ASSERT_GT(bytes, 0);
    const std::vector<hsize_t> origin(size.size(), 0);
    ASSERT_GE(
        H5Dwrite_chunk(*data, H5P_DEFAULT, 0, origin.data(), static_cast<std::size_t>(bytes), packed.data()),
        0);
  }

 private:
  static std::size_t pass_on(unsigned, std::size_t, const unsigned[], std::size_t bytes, std::size_t*,
                             void**) {
    return bytes;
  }
  Hdf5Handle file_;
};

/// Events with whole microseconds as columns, stamps counted from `zero_us`.
void put_events(Hdf5Maker& maker, const std::string& group, const Packet& packet, std::int64_t zero_us,
                Filter filter) {
  std::vector<std::int64_t> t;
  std::vector<std::uint16_t> x, y;
  std::vector<std::uint8_t> p;
  for (const Event& e : packet.events) {
    t.push_back(e.t / 1000 - zero_us);
    x.push_back(e.x);
    y.push_back(e.y);
    p.push_back(e.polarity ? 1 : 0);
  }
  const std::vector<hsize_t> size{packet.events.size()};
  maker.column(group + "/t", H5T_NATIVE_INT64, t, size, filter);
  maker.column(group + "/x", H5T_NATIVE_UINT16, x, size, filter);
  maker.column(group + "/y", H5T_NATIVE_UINT16, y, size, filter);
  maker.column(group + "/p", H5T_NATIVE_UINT8, p, size, filter);
}

std::string tum_vie_imu(const Packet& packet) {
  std::string text = "#timestamp gx gy gz ax ay az temperature\n";
  for (const ImuSample& s : packet.imu)
    text += fmt::format("{} {} {} {} {} {} {} 31.5\n", s.t / 1000, s.gyro.x(), s.gyro.y(), s.gyro.z(),
                        s.accel.x(), s.accel.y(), s.accel.z());
  return text;
}

TEST(Hdf5, WrittenAndReadBack) {
  const TempDir dir;
  for (const bool compress : {false, true}) {
    const fs::path path = dir.path() / "r.h5";
    write(path, {some_packet()}, compress, some_truth());
    expect_same(read_back(path), some_packet());
    const auto recording = open_recording(path);
    EXPECT_EQ(recording->resolution().width, 240);
    const auto truth = recording->groundtruth();
    ASSERT_TRUE(truth);
    ASSERT_EQ(truth->size(), some_truth().size());
    EXPECT_EQ((*truth)[3].t, some_truth()[3].t);
    EXPECT_EQ((*truth)[3].T.p, some_truth()[3].T.p);
  }
}

TEST(Hdf5, Dsec) {
  const TempDir dir;
  const Packet packet = some_packet();
  const std::int64_t zero_us = packet.events[0].t / 1000 - 5;
  fs::create_directories(dir.path() / "events/left");
  const fs::path path = dir.path() / "events/left/events.h5";
  {
    Hdf5Maker maker(path);
    put_events(maker, "events", packet, zero_us, Filter::kBlosc);
    maker.column("t_offset", H5T_NATIVE_INT64, std::vector<std::int64_t>{zero_us}, {});
    maker.column("ms_to_idx", H5T_NATIVE_INT64, std::vector<std::int64_t>{0, 7}, {2});
  }
  EXPECT_FALSE(open_recording(path)->has_imu());
  EXPECT_EQ(read_back(path).events, packet.events);
  Packet imu;
  imu.imu = packet.imu;
  write(dir.path() / "lidar_imu.bag", {imu}, false);
  expect_same(read_back(path), packet);
  expect_same(read_back(path.parent_path()), packet);
  EXPECT_EQ(open_recording(path)->format(), "HDF5 (DSEC)");
}

TEST(Hdf5, TumVie) {
  const TempDir dir;
  const Packet packet = some_packet();
  const fs::path path = dir.path() / "slide-events_left.h5";
  {
    Hdf5Maker maker(path);
    put_events(maker, "events", packet, 0, Filter::kBlosc);
  }
  EXPECT_NE(read_back(path, {{}, {}, {}, dir.path() / "absent"}).error, "");
  fs::create_directories(dir.path() / "slide-vi_gt_data");
  dir.write("slide-vi_gt_data/imu_data.txt", tum_vie_imu(packet));
  expect_same(read_back(path), packet);
  EXPECT_EQ(open_recording(path)->format(), "HDF5 (TUM-VIE)");
}

TEST(Hdf5, M3ed) {
  const TempDir dir;
  const Packet packet = some_packet();
  const std::int64_t zero_us = packet.events[0].t / 1000;
  std::vector<std::int64_t> t;
  std::vector<double> accel, omega;
  for (const ImuSample& s : packet.imu) {
    t.push_back(s.t / 1000 - zero_us);
    accel.insert(accel.end(), s.accel.data(), s.accel.data() + 3);
    omega.insert(omega.end(), s.gyro.data(), s.gyro.data() + 3);
  }
  // A sample that was lost.
  t.insert(t.begin() + 1, std::numeric_limits<std::int64_t>::min());
  accel.insert(accel.begin() + 3, 3, NAN);
  omega.insert(omega.begin() + 3, 3, NAN);
  {
    Hdf5Maker maker(dir.path() / "x_data.h5");
    for (const char* camera : {"prophesee/left", "prophesee/right"})
      put_events(maker, camera, packet, zero_us, Filter::kZlib);
    maker.column("prophesee/left/calib/resolution", H5T_NATIVE_INT64, std::vector<std::int64_t>{1280, 720},
                 {2});
    maker.column("ovc/imu/ts", H5T_NATIVE_INT64, t, {t.size()}, Filter::kZlib);
    maker.column("ovc/imu/accel", H5T_NATIVE_DOUBLE, accel, {t.size(), 3});
    maker.column("ovc/imu/omega", H5T_NATIVE_DOUBLE, omega, {t.size(), 3});
  }
  Packet expected = packet;
  for (Event& e : expected.events) e.t -= zero_us * 1000;
  for (ImuSample& s : expected.imu) s.t -= zero_us * 1000;
  expect_same(read_back(dir.path() / "x_data.h5"), expected);
  EXPECT_EQ(open_recording(dir.path() / "x_data.h5")->resolution().height, 720);
  EXPECT_EQ(read_back(dir.path() / "x_data.h5", {"prophesee/right", {}, {}, {}}).events.size(),
            expected.events.size());
  expect_says(read_back(dir.path() / "x_data.h5", {"prophesee/up", {}, {}, {}}).error, {"prophesee/right"});

  // Truth: the first frame seen from the present one.
  EXPECT_EQ(open_recording(dir.path() / "x_data.h5")->groundtruth(), std::nullopt);
  {
    Hdf5Maker maker(dir.path() / "x_pose_gt.h5");
    maker.column("ts", H5T_NATIVE_INT64, std::vector<std::int64_t>{10, 20}, {2});
    std::vector<double> T(32, 0.0);
    for (const std::size_t i : {0, 5, 10, 15, 16, 21, 26, 31}) T[i] = 1;
    T[19] = -2;
    maker.column("Cn_T_C0", H5T_NATIVE_DOUBLE, T, {2, 4, 4});
  }
  const auto truth = open_recording(dir.path() / "x_data.h5")->groundtruth();
  ASSERT_TRUE(truth);
  EXPECT_EQ((*truth)[1].t, 20000);
  EXPECT_LT(((*truth)[1].T.p - Vec3(2, 0, 0)).norm(), 1e-12);
}

TEST(Hdf5, OtherLayoutsAndShapes) {
  const TempDir dir;
  const fs::path path = dir.path() / "o.h5";
  { Hdf5Maker(path).column("a/b", H5T_NATIVE_INT64, std::vector<std::int64_t>{1}, {1}); }
  expect_says(read_back(path).error, {"o.h5", "DSEC", "M3ED"});
  {
    Hdf5Maker maker(path);
    put_events(maker, "events", some_packet(), 0, Filter::kNone);
    maker.column("t_offset", H5T_NATIVE_INT64, std::vector<std::int64_t>{0, 0}, {1, 2});
  }
  EXPECT_EQ(read_back(path).events.size(), 5000u);
  {
    Hdf5Maker maker(path);
    const std::vector<std::int64_t> numbers(6, 1);
    maker.column("events/t", H5T_NATIVE_INT64, numbers, {6});
    maker.column("events/x", H5T_NATIVE_INT64, numbers, {5});
    maker.column("events/y", H5T_NATIVE_INT64, numbers, {6});
    maker.column("events/p", H5T_NATIVE_INT64, numbers, {6});
  }
  const ReadBack unequal = read_back(path);
  EXPECT_EQ(unequal.events.size(), 5u);
  EXPECT_EQ(unequal.warnings.count("unequal_columns"), 1u);
}

// What the files of datasets seldom have, but h5py writes.
TEST(Hdf5, OtherChunksAndNumbers) {
  const TempDir dir;
  const fs::path path = dir.path() / "o.h5";
  constexpr hsize_t kRows = 100, kWidth = 3;
  std::vector<double> values;
  for (hsize_t i = 0; i < kRows * kWidth; ++i) values.push_back(static_cast<double>(i) - 0.5);
  {
    const auto file = own_hdf5(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    const auto creation = own_hdf5(H5Pcreate(H5P_DATASET_CREATE));
    // A chunk holds a part of each row, as h5py chooses it.
    const std::array<hsize_t, 2> size{kRows, kWidth}, chunk{16, 2}, part{4, kWidth};
    H5Pset_chunk(*creation, 2, chunk.data());
    H5Pset_shuffle(*creation);
    H5Pset_deflate(*creation, 1);
    H5Pset_fletcher32(*creation);
    const auto space = own_hdf5(H5Screate_simple(2, size.data(), nullptr));
    const auto matrix =
        own_hdf5(H5Dcreate2(*file, "matrix", H5T_IEEE_F64BE, *space, H5P_DEFAULT, *creation, H5P_DEFAULT));
    ASSERT_GE(H5Dwrite(*matrix, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
    const std::int32_t fill = 300;
    H5Pset_fill_value(*creation, H5T_NATIVE_INT32, &fill);
    const auto partly =
        own_hdf5(H5Dcreate2(*file, "partly", H5T_STD_I32BE, *space, H5P_DEFAULT, *creation, H5P_DEFAULT));
    const auto memory = own_hdf5(H5Screate_simple(2, part.data(), nullptr));
    const std::array<hsize_t, 2> origin{};
    H5Sselect_hyperslab(*space, H5S_SELECT_SET, origin.data(), nullptr, part.data(), nullptr);
    ASSERT_GE(H5Dwrite(*partly, H5T_NATIVE_DOUBLE, *memory, *space, H5P_DEFAULT, values.data()), 0);
    const hsize_t many = hsize_t{1} << 40, few = 1000;
    const auto endless = own_hdf5(H5Screate_simple(1, &many, nullptr));
    H5Pset_chunk(*creation, 1, &few);
    ASSERT_TRUE(
        own_hdf5(H5Dcreate2(*file, "endless", H5T_STD_I32LE, *endless, H5P_DEFAULT, *creation, H5P_DEFAULT)));
  }
  const Hdf5File file(path);
  std::vector<double> read;
  file.column("matrix").read(0, kRows, read);
  EXPECT_EQ(read, values);
  file.column("matrix").read(15, 2, read);
  EXPECT_EQ(read, std::vector<double>(values.begin() + 15 * kWidth, values.begin() + 17 * kWidth));
  std::vector<std::int8_t> small;
  file.column("partly").read(3, 2, small);
  EXPECT_EQ(small, (std::vector<std::int8_t>{8, 9, 10, 127, 127, 127}));
  try {
    static_cast<void>(file.column("endless"));
    ADD_FAILURE();
  } catch (const DataError& error) {
    expect_says(error.what(), {"o.h5", "/endless", "never written"});
  }
}

TEST(Hdf5, DamageIsToldOfAndDoesNoHarm) {
  const TempDir dir;
  write(dir.path() / "r.h5", {some_packet(0), some_packet(1)}, true, some_truth());
  const std::string whole = slurp(dir.path() / "r.h5");
  expect_says(read_back(dir.write("damaged", whole.substr(0, whole.size() / 2))).error, {"damaged", "HDF5"});
  expect_survives_damage(dir, whole);
}

TEST(Hdf5, PartBeforeDamagedChunkIsKept) {
  const TempDir dir;
  const fs::path path = dir.path() / "r.h5";
  std::vector<Packet> packets;
  for (int part = 0; part < 30; ++part) packets.push_back(some_packet(part));
  write(path, packets, true);
  std::string whole = slurp(path);
  haddr_t address = 0;
  {
    const auto file = own_hdf5(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
    const auto data = own_hdf5(H5Dopen2(*file, "events/x", H5P_DEFAULT));
    const hsize_t second = 1 << 16;
    unsigned mask = 0;
    hsize_t size = 0;
    ASSERT_GE(H5Dget_chunk_info_by_coord(*data, &second, &mask, &address, &size), 0);
  }
  for (std::size_t i = 0; i < 100; ++i) whole[address + i] = '\x55';
  const ReadBack r = read_back(dir.write("damaged", whole));
  expect_says(r.error, {"damaged", "row"});
  EXPECT_EQ(r.events.size(), 65536u);
}

}  // namespace
}  // namespace idol::test
