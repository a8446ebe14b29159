#include "idol/io/hdf5_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "idol/base/diagnostics.hpp"
#include "idol/io/bytes.hpp"
#include "idol/io/hdf5_dataset.hpp"
#include "idol/io/hdf5_tables.hpp"
#include "idol/io/random_file.hpp"

namespace idol {
namespace {

/// The nearest number of the other type; 0 for NaN.
template <class To, class From>
To converted(From value) {
  using Limits = std::numeric_limits<To>;
  if constexpr (std::is_floating_point_v<To>) {
    return static_cast<To>(value);
  } else if constexpr (std::is_floating_point_v<From>) {
    if (!(value > static_cast<From>(Limits::min()))) return value == value ? Limits::min() : To{0};
    return value < static_cast<From>(Limits::max()) ? static_cast<To>(value) : Limits::max();
  } else {
    if (std::cmp_less(value, Limits::min())) return Limits::min();
    return std::cmp_less(value, Limits::max()) ? static_cast<To>(value) : Limits::max();
  }
}

template <class From, class To>
void convert(Bytes raw, To* out) {
  const std::size_t count = raw.size() / sizeof(From);
  if constexpr (std::is_same_v<From, To>) {
    std::memcpy(out, raw.data(), count * sizeof(To));
  } else {
    for (std::size_t i = 0; i < count; ++i) {
      From value;
      std::memcpy(&value, raw.data() + i * sizeof(From), sizeof(From));
      out[i] = converted<To>(value);
    }
  }
}

template <class To>
void convert(const Hdf5Dataset& set, Bytes raw, To* out) {
  if (set.is_float) return set.bytes == 4 ? convert<float>(raw, out) : convert<double>(raw, out);
  const bool s = set.is_signed;
  switch (set.bytes) {
    case 1:
      return s ? convert<std::int8_t>(raw, out) : convert<std::uint8_t>(raw, out);
    case 2:
      return s ? convert<std::int16_t>(raw, out) : convert<std::uint16_t>(raw, out);
    case 4:
      return s ? convert<std::int32_t>(raw, out) : convert<std::uint32_t>(raw, out);
    default:
      return s ? convert<std::int64_t>(raw, out) : convert<std::uint64_t>(raw, out);
  }
}

/// One number of each record, side by side.
std::vector<std::uint8_t> members(const Hdf5Dataset& set, Bytes records) {
  std::vector<std::uint8_t> out;
  for (std::size_t at = set.record_at; at + set.bytes <= records.size(); at += set.record_bytes)
    out.insert(out.end(), records.begin() + static_cast<std::ptrdiff_t>(at),
               records.begin() + static_cast<std::ptrdiff_t>(at + set.bytes));
  return out;
}

void swap_bytes(std::size_t width, std::vector<std::uint8_t>& data) {
  for (auto at = data.begin(); at + static_cast<std::ptrdiff_t>(width) <= data.end();
       at += static_cast<std::ptrdiff_t>(width))
    std::reverse(at, at + static_cast<std::ptrdiff_t>(width));
}

}  // namespace

/// The rows as stored, numbers little-endian. Holds what was read last: pieces need not begin where chunks
/// do.
class Hdf5Column::Data {
 public:
  Data(std::shared_ptr<const RandomFile> file, Hdf5Dataset set)
      : file_(std::move(file)), set_(std::move(set)) {}

  [[nodiscard]] const Hdf5Dataset& set() const { return set_; }

  /// The rows from `begin` on, up to `count`, at least one. Throws BadBytes or DataError on damage.
  Bytes rows(std::uint64_t begin, std::size_t count) {
    const std::size_t row = set_.row_bytes();
    if (set_.storage == Hdf5Dataset::Storage::kChunked) {
      const std::uint64_t block = begin / set_.chunk[0];
      if (block != block_) load_block(block);
      const auto from = static_cast<std::size_t>(begin - block * set_.chunk[0]);
      return Bytes(data_).subspan(from * row, std::min<std::size_t>(count, set_.chunk[0] - from) * row);
    }
    if (set_.storage == Hdf5Dataset::Storage::kContiguous) {
      file_->read(set_.address + begin * row, count * row, data_);
    } else {
      const auto from = set_.compact.begin() + static_cast<std::ptrdiff_t>(begin * row);
      data_.assign(from, from + static_cast<std::ptrdiff_t>(count * row));
    }
    if (set_.big_endian) swap_bytes(set_.bytes, data_);
    return data_;
  }

 private:
  /// As many rows as a chunk has. h5py's chunks may hold a part of each row.
  void load_block(std::uint64_t block) {
    block_ = kNone;
    const std::array<std::uint64_t, 3>&chunk = set_.chunk, &size = set_.size;
    if (chunk[1] == size[1] && chunk[2] == size[2]) {
      load_chunk({block * chunk[0], 0, 0}, data_);
    } else {
      std::vector<std::uint8_t> part;
      for (std::uint64_t i = 0; i < size[1]; i += chunk[1])
        for (std::uint64_t j = 0; j < size[2]; j += chunk[2]) {
          load_chunk({block * chunk[0], i, j}, part);
          data_.resize(static_cast<std::size_t>(chunk[0]) * set_.row_bytes());
          place(part, i, j);
        }
    }
    if (set_.big_endian) swap_bytes(set_.bytes, data_);
    block_ = block;
  }

  void place(const std::vector<std::uint8_t>& part, std::uint64_t i, std::uint64_t j) {
    const std::array<std::uint64_t, 3>&chunk = set_.chunk, &size = set_.size;
    const auto numbers = static_cast<std::size_t>(std::min(chunk[2], size[2] - j));
    for (std::uint64_t r = 0; r < chunk[0]; ++r)
      for (std::uint64_t c = 0; c < std::min(chunk[1], size[1] - i); ++c) {
        const auto from = static_cast<std::size_t>((r * chunk[1] + c) * chunk[2]);
        const auto to = static_cast<std::size_t>((r * size[1] + i + c) * size[2] + j);
        std::memcpy(data_.data() + to * set_.bytes, part.data() + from * set_.bytes, numbers * set_.bytes);
      }
  }

  void load_chunk(const std::array<std::uint64_t, 3>& at, std::vector<std::uint8_t>& out) const {
    const std::size_t bytes = set_.chunk_bytes();
    const auto found =
        std::lower_bound(set_.chunks.begin(), set_.chunks.end(), at,
                         [](const Hdf5Chunk& chunk, const auto& wanted) { return chunk.at < wanted; });
    if (found == set_.chunks.end() || found->at != at) {
      out.assign(bytes, 0);
      if (!set_.fill.empty())
        for (std::size_t i = 0; i < bytes; ++i) out[i] = set_.fill[i % set_.bytes];
      return;
    }
    if (found->address > file_->size() || found->size > file_->size() - found->address)
      throw BadBytes{"an address leads outside the file"};
    file_->read(found->address, static_cast<std::size_t>(found->size), out);
    decode_hdf5_chunk(set_.filters, found->skipped, bytes, out);
  }

  static constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();
  std::shared_ptr<const RandomFile> file_;
  Hdf5Dataset set_;
  std::uint64_t block_ = kNone;  // of chunks, that data_ holds
  std::vector<std::uint8_t> data_;
};

std::uint64_t Hdf5Column::rows() const { return data_->set().size[0]; }
std::uint64_t Hdf5Column::width() const { return data_->set().width(); }
bool Hdf5Column::is_float() const { return data_->set().is_float; }

template <class T>
void Hdf5Column::read(std::uint64_t begin, std::size_t count, std::vector<T>& out) const {
  if (begin > rows() || count > rows() - begin)
    throw DataError(fmt::format("{}: {} rows, but {} are asked for", name_, rows(), begin + count));
  const auto row_width = static_cast<std::size_t>(width());
  out.resize(count * row_width);
  for (std::size_t done = 0; done < count;) try {
      const Hdf5Dataset& set = data_->set();
      const Bytes raw = data_->rows(begin + done, count - done);
      if (set.record_bytes > 0)
        convert(set, members(set, raw), out.data() + done * row_width);
      else
        convert(set, raw, out.data() + done * row_width);
      done += raw.size() / set.row_bytes();
    } catch (const BadBytes& bad) {
      throw DataError(
          fmt::format("{}, row {}: cannot be read: the file is damaged: {}", name_, begin + done, bad.why));
    } catch (const UnknownFormat& unknown) {
      throw DataError(fmt::format("{}: {}", name_, unknown.what()));
    }
}

template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::int64_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::uint16_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<std::int8_t>&) const;
template void Hdf5Column::read(std::uint64_t, std::size_t, std::vector<double>&) const;

Hdf5File::Hdf5File(const std::filesystem::path& path) : file_(std::make_shared<RandomFile>(path)) {
  try {
    root_ = hdf5_root(*file_);
  } catch (const BadBytes& bad) {
    throw DataError(
        fmt::format("{}: cannot be opened as an HDF5 file: it is damaged, cut off, or was never closed: {}",
                    name(), bad.why));
  } catch (const UnknownFormat& unknown) {
    throw DataError(fmt::format("{}: {}", name(), unknown.what()));
  }
}

const std::string& Hdf5File::name() const { return file_->name(); }

bool Hdf5File::has(const std::string& path) const {
  try {
    return find_hdf5_object(*file_, root_, path).has_value();
  } catch (const BadBytes& bad) {
    throw DataError(
        fmt::format("{}: /{}: cannot be looked up: the file is damaged: {}", name(), path, bad.why));
  } catch (const UnknownFormat& unknown) {
    throw DataError(fmt::format("{}: /{}: {}", name(), path, unknown.what()));
  }
}

Hdf5Column Hdf5File::column(const std::string& path, const std::string& member) const {
  Hdf5Column column;
  column.name_ = fmt::format("{}: /{}{}{}", name(), path, member.empty() ? "" : ", ", member);
  try {
    const auto address = find_hdf5_object(*file_, root_, path);
    if (!address) throw DataError(fmt::format("{}: there is no such data set", column.name_));
    column.data_ = std::make_shared<Hdf5Column::Data>(file_, read_hdf5_dataset(*file_, *address, member));
  } catch (const BadBytes& bad) {
    throw DataError(fmt::format("{}: the data set cannot be read, or is damaged: {}", column.name_, bad.why));
  } catch (const UnknownFormat& unknown) {
    throw DataError(fmt::format("{}: {}", column.name_, unknown.what()));
  }
  return column;
}

}  // namespace idol
