#include "idol/io/hdf5_file.hpp"

#include <fmt/format.h>
#include <hdf5.h>

#include <algorithm>
#include <array>

#include "idol/base/diagnostics.hpp"
#include "idol/io/hdf5_filters.hpp"

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

template <class T>
Hdf5Id native_type();
template <>
Hdf5Id native_type<std::int64_t>() {
  return H5T_NATIVE_INT64;
}
template <>
Hdf5Id native_type<std::uint16_t>() {
  return H5T_NATIVE_UINT16;
}
template <>
Hdf5Id native_type<std::int8_t>() {
  return H5T_NATIVE_INT8;
}
template <>
Hdf5Id native_type<double>() {
  return H5T_NATIVE_DOUBLE;
}

/// The library would print its errors.
void prepare_library() {
  static const bool done = [] {
    H5open();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    register_hdf5_filters();
    return true;
  }();
  static_cast<void>(done);
}

/// A whole chunk fits in the cache: one that did not would be decompressed for every piece read of it.
Hdf5Handle access_of(Hdf5Id file, const std::string& path) {
  constexpr std::size_t kLeast = 1 << 20, kMost = 1 << 28;
  const auto access = own_hdf5(H5Pcreate(H5P_DATASET_ACCESS));
  const auto dataset = own_hdf5(H5Dopen2(file, path.c_str(), H5P_DEFAULT));
  if (!dataset) return access;
  const auto creation = own_hdf5(H5Dget_create_plist(*dataset));
  const auto type = own_hdf5(H5Dget_type(*dataset));
  std::array<hsize_t, H5S_MAX_RANK> chunk{};
  if (!creation || !type || H5Pget_layout(*creation) != H5D_CHUNKED) return access;
  const int rank = H5Pget_chunk(*creation, H5S_MAX_RANK, chunk.data());
  double bytes = static_cast<double>(H5Tget_size(*type));
  for (int i = 0; i < rank; ++i) bytes *= static_cast<double>(chunk[static_cast<std::size_t>(i)]);
  if (bytes > static_cast<double>(kMost)) return access;
  H5Pset_chunk_cache(*access, H5D_CHUNK_CACHE_NSLOTS_DEFAULT,
                     std::max(kLeast, 2 * static_cast<std::size_t>(bytes)), 1.0);
  return access;
}

}  // namespace

Hdf5Handle own_hdf5(Hdf5Id id) {
  if (id < 0) return nullptr;
  return {new Hdf5Id(id), [](const Hdf5Id* owned) {
            close(*owned);
            delete owned;
          }};
}

Hdf5File::Hdf5File(const std::filesystem::path& path) : name_(path.string()) {
  prepare_library();
  const auto access = own_hdf5(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_file_locking(*access, false, true);  // some file systems know no locks, and nothing is written
  file_ = own_hdf5(H5Fopen(name_.c_str(), H5F_ACC_RDONLY, *access));
  if (!file_)
    throw DataError(fmt::format(
        "{}: cannot be opened as an HDF5 file: it is damaged, cut off, or was never closed", name_));
}

bool Hdf5File::has(const std::string& path) const {
  // The library wants each part of a path asked for.
  for (auto slash = path.find('/'); slash != std::string::npos; slash = path.find('/', slash + 1))
    if (H5Lexists(*file_, path.substr(0, slash).c_str(), H5P_DEFAULT) <= 0) return false;
  return H5Lexists(*file_, path.c_str(), H5P_DEFAULT) > 0;
}

Hdf5Column Hdf5File::column(const std::string& path) const {
  Hdf5Column column;
  column.name_ = fmt::format("{}: /{}", name_, path);
  const auto refuse = [&](const char* why) { throw DataError(fmt::format("{}: {}", column.name_, why)); };
  if (!has(path)) refuse("there is no such data set");
  column.dataset_ = own_hdf5(H5Dopen2(*file_, path.c_str(), *access_of(*file_, path)));
  if (!column.dataset_) refuse("the data set is damaged");
  const auto type = own_hdf5(H5Dget_type(*column.dataset_));
  const H5T_class_t kind = type ? H5Tget_class(*type) : H5T_NO_CLASS;
  if (kind != H5T_INTEGER && kind != H5T_FLOAT && kind != H5T_ENUM)
    refuse("the data set does not hold numbers");
  const auto space = own_hdf5(H5Dget_space(*column.dataset_));
  const int rank = space ? H5Sget_simple_extent_ndims(*space) : -1;
  constexpr int kMostDimensions = 3;  // a matrix a row
  if (rank < 0 || rank > kMostDimensions) refuse("the data set is no table");
  std::array<hsize_t, kMostDimensions> size{1, 1, 1};
  H5Sget_simple_extent_dims(*space, size.data(), nullptr);
  column.rows_ = size[0];
  constexpr hsize_t kWidest = 16;
  if (size[1] == 0 || size[2] == 0 || size[1] > kWidest || size[2] > kWidest)
    refuse("its rows have another width");
  column.width_ = size[1] * size[2];
  return column;
}

// The library trusts a damaged index: it copies a whole chunk from fewer bytes if these are said to be stored
// as they are, or come out of a filter. So sizes are looked at before it reads.
bool Hdf5Column::chunks_are_whole(std::uint64_t begin, std::size_t count) const {
  const auto creation = own_hdf5(H5Dget_create_plist(*dataset_));
  const auto type = own_hdf5(H5Dget_type(*dataset_));
  if (!creation || !type) return false;
  if (H5Pget_layout(*creation) != H5D_CHUNKED) return true;
  std::array<hsize_t, 3> chunk{1, 1, 1}, offset{};
  if (H5Pget_chunk(*creation, static_cast<int>(chunk.size()), chunk.data()) < 0 || chunk[0] == 0)
    return false;
  const hsize_t bytes = chunk[0] * chunk[1] * chunk[2] * H5Tget_size(*type);
  expect_hdf5_chunk(bytes);
  const bool filtered = H5Pget_nfilters(*creation) > 0;
  for (offset[0] = begin / chunk[0] * chunk[0]; offset[0] < begin + count; offset[0] += chunk[0]) {
    unsigned skipped = 0;
    haddr_t address = HADDR_UNDEF;
    hsize_t size = 0;
    if (H5Dget_chunk_info_by_coord(*dataset_, offset.data(), &skipped, &address, &size) < 0) return false;
    if (address != HADDR_UNDEF && (!filtered || skipped != 0) && size < bytes) return false;
  }
  return true;
}

void Hdf5Column::read_as(Hdf5Id type, std::uint64_t begin, std::size_t count, void* out) const {
  if (count == 0) return;
  const auto space = own_hdf5(H5Dget_space(*dataset_));
  std::array<hsize_t, 3> size{}, from{}, to_read{};
  const int rank = space ? H5Sget_simple_extent_dims(*space, size.data(), nullptr) : -1;
  to_read = size;
  from[0] = begin;
  to_read[0] = count;
  bool good = rank >= 0;
  if (rank > 0)
    good = H5Sselect_hyperslab(*space, H5S_SELECT_SET, from.data(), nullptr, to_read.data(), nullptr) >= 0;
  good = good && (rank == 0 || chunks_are_whole(begin, count));
  const hsize_t points = count * width_;
  const auto memory = own_hdf5(H5Screate_simple(1, &points, nullptr));
  good = good && memory && H5Dread(*dataset_, type, *memory, *space, H5P_DEFAULT, out) >= 0;
  if (good) return;
  throw DataError(fmt::format(
      "{}, row {}: cannot be read: the file is damaged or cut off, or compressed in a way that is "
      "not known here",
      name_, begin));
}

template <class T>
void Hdf5Column::read(std::uint64_t begin, std::size_t count, std::vector<T>& out) const {
  if (begin > rows_ || count > rows_ - begin)
    throw DataError(fmt::format("{}: {} rows, but {} are asked for", name_, rows_, begin + count));
  out.resize(count * width_);
  read_as(native_type<T>(), begin, count, out.data());
}

template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::int64_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::uint16_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::int8_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<double>&) const;

}  // namespace idol
