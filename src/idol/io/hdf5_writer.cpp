#include "idol/io/hdf5_writer.hpp"

#include <fmt/format.h>
#include <hdf5.h>

#include <array>

#include "idol/base/diagnostics.hpp"

namespace idol {

static_assert(sizeof(Hdf5Id) == sizeof(hid_t));

namespace {

void close(Hdf5Id id) {
  switch (H5Iget_type(id)) {
    case H5I_FILE:
      H5Fclose(id);
      break;
    case H5I_DATASET:
      H5Dclose(id);
      break;
    case H5I_DATASPACE:
      H5Sclose(id);
      break;
    case H5I_DATATYPE:
      H5Tclose(id);
      break;
    case H5I_GROUP:
      H5Gclose(id);
      break;
    case H5I_GENPROP_LST:
      H5Pclose(id);
      break;
    default:
      break;
  }
}

constexpr hsize_t kChunkRows = 1 << 16;

template <class T>
Hdf5Id stored_type();
template <>
Hdf5Id stored_type<std::int64_t>() {
  return H5T_NATIVE_INT64;
}
template <>
Hdf5Id stored_type<std::uint16_t>() {
  return H5T_NATIVE_UINT16;
}
template <>
Hdf5Id stored_type<std::uint8_t>() {
  return H5T_NATIVE_UINT8;
}
template <>
Hdf5Id stored_type<double>() {
  return H5T_NATIVE_DOUBLE;
}

void append_vec3(std::vector<double>& values, const Vec3& v) {
  values.insert(values.end(), v.data(), v.data() + 3);
}

}  // namespace

Hdf5Handle own_hdf5(Hdf5Id id) {
  if (id < 0) return nullptr;
  return {new Hdf5Id(id), [](const Hdf5Id* owned) {
            close(*owned);
            delete owned;
          }};
}

Hdf5Writer::Hdf5Writer(const std::filesystem::path& path, const WriterOptions& options)
    : name_(path.string()), pending_(path), compress_(options.compress) {
  H5open();
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  file_ = own_hdf5(H5Fcreate(pending_.path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  check(file_ != nullptr);
  const std::array<std::int64_t, 3> about{1, options.width, options.height};
  const hsize_t size = about.size();
  const auto space = own_hdf5(H5Screate_simple(1, &size, nullptr));
  const auto dataset = own_hdf5(
      H5Dcreate2(*file_, "idol_recording", H5T_NATIVE_INT64, *space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  check(dataset && H5Dwrite(*dataset, H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, about.data()) >= 0);
}

void Hdf5Writer::check(bool good) const {
  if (!good)
    throw DataError(fmt::format(
        "{}: cannot be written: no such folder, no right to write there, or the disk is full", name_));
}

Hdf5Handle Hdf5Writer::create(const std::string& path, Hdf5Id type, std::uint64_t width) {
  const int rank = width == 1 ? 1 : 2;
  const std::array<hsize_t, 2> none{0, width}, any{H5S_UNLIMITED, width}, chunk{kChunkRows, width};
  const auto space = own_hdf5(H5Screate_simple(rank, none.data(), any.data()));
  const auto links = own_hdf5(H5Pcreate(H5P_LINK_CREATE)), creation = own_hdf5(H5Pcreate(H5P_DATASET_CREATE));
  H5Pset_create_intermediate_group(*links, 1);
  H5Pset_chunk(*creation, rank, chunk.data());
  if (compress_) {
    constexpr unsigned kLevel = 4;
    H5Pset_shuffle(*creation);
    H5Pset_deflate(*creation, kLevel);
  }
  auto dataset = own_hdf5(H5Dcreate2(*file_, path.c_str(), type, *space, *links, *creation, H5P_DEFAULT));
  check(dataset != nullptr);
  return dataset;
}

template <class T>
void Hdf5Writer::append(const std::string& path, const std::vector<T>& values, std::uint64_t width) {
  Column& column = columns_[path];
  if (!column.dataset) column.dataset = create(path, stored_type<T>(), width);
  const int rank = width == 1 ? 1 : 2;
  const std::uint64_t rows = values.size() / width;
  const std::array<hsize_t, 2> from{column.rows, 0}, count{rows, width}, size{column.rows + rows, width};
  check(H5Dset_extent(*column.dataset, size.data()) >= 0);
  const auto space = own_hdf5(H5Dget_space(*column.dataset));
  const auto memory = own_hdf5(H5Screate_simple(rank, count.data(), nullptr));
  check(H5Sselect_hyperslab(*space, H5S_SELECT_SET, from.data(), nullptr, count.data(), nullptr) >= 0);
  check(H5Dwrite(*column.dataset, stored_type<T>(), *memory, *space, H5P_DEFAULT, values.data()) >= 0);
  column.rows += rows;
}

void Hdf5Writer::add(const Packet& packet) {
  if (!packet.events.empty()) {
    std::vector<Time> t;
    std::vector<std::uint16_t> x, y;
    std::vector<std::uint8_t> p;
    for (const Event& e : packet.events) {
      t.push_back(e.t);
      x.push_back(e.x);
      y.push_back(e.y);
      p.push_back(e.polarity ? 1 : 0);
    }
    append("events/t", t);
    append("events/x", x);
    append("events/y", y);
    append("events/p", p);
  }
  if (packet.imu.empty()) return;
  std::vector<Time> t;
  std::vector<double> accel, gyro;
  for (const ImuSample& s : packet.imu) {
    t.push_back(s.t);
    append_vec3(accel, s.accel);
    append_vec3(gyro, s.gyro);
  }
  append("imu/t", t);
  append("imu/accel", accel, 3);
  append("imu/gyro", gyro, 3);
}

bool Hdf5Writer::add_groundtruth(const Trajectory& truth) {
  std::vector<Time> t;
  std::vector<double> position, orientation;
  for (const auto& [stamp, T] : truth) {
    t.push_back(stamp);
    append_vec3(position, T.p);
    append_vec3(orientation, T.q.vec());
    orientation.push_back(T.q.w());
  }
  append("groundtruth/t", t);
  append("groundtruth/position", position, 3);
  append("groundtruth/orientation", orientation, 4);
  return true;
}

void Hdf5Writer::close() {
  check(H5Fflush(*file_, H5F_SCOPE_GLOBAL) >= 0);
  columns_.clear();
  file_.reset();
  pending_.commit();
}

}  // namespace idol
