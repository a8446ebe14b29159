#include "idol/io/hdf5_dataset.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "idol/io/hdf5_tables.hpp"

namespace idol {
namespace {

constexpr std::uint64_t kLargestChunk = 1U << 30;

void read_dataspace(const Hdf5Message& message, Hdf5Dataset& set, std::size_t& rank) {
  ByteCursor cursor(message.data);
  const auto version = cursor.get<std::uint8_t>();
  rank = cursor.get<std::uint8_t>();
  static_cast<void>(cursor.get<std::uint8_t>());
  constexpr std::uint8_t kNull = 2;
  if (version == 1)
    static_cast<void>(cursor.take(5));
  else if (cursor.get<std::uint8_t>() == kNull)
    throw BadBytes{"it is empty"};
  if (rank > set.size.size()) throw BadBytes{"it is no table"};
  for (std::size_t i = 0; i < rank; ++i) set.size[i] = cursor.get<std::uint64_t>();
  constexpr std::uint64_t kWidest = 16, kMostRows = std::uint64_t{1} << 48;
  if (set.size[0] > kMostRows) throw BadBytes{"it states more rows than can be"};
  for (const std::size_t i : {1U, 2U})
    if (set.size[i] == 0 || set.size[i] > kWidest) throw BadBytes{"its rows have another width"};
}

[[noreturn]] void refuse_type(const char* what) {
  throw UnknownFormat(fmt::format("it holds {}, which is not read; convert it to columns of numbers", what));
}

enum TypeClass : int { kInteger = 0, kFloat = 1, kRecord = 6, kEnum = 8 };
constexpr std::size_t kTypeHead = 8;

void read_number_type(Bytes data, Hdf5Dataset& set) {
  int kind = load<std::uint8_t>(data, 0) & 0x0f;
  if (kind == kEnum) {  // h5py's booleans
    data = data.subspan(std::min(kTypeHead, data.size()));
    kind = load<std::uint8_t>(data, 0) & 0x0f;
    if (kind != kInteger) refuse_type("no numbers");
  }
  if (kind == kRecord) refuse_type("records");
  if (kind != kInteger && kind != kFloat) refuse_type("no numbers");
  const auto flags = load<std::uint8_t>(data, 1);
  set.bytes = load<std::uint32_t>(data, 4);
  set.is_float = kind == kFloat;
  set.big_endian = (flags & 0x01) != 0;
  set.is_signed = (flags & 0x08) != 0;
  const bool usual = set.is_float ? set.bytes == 4 || set.bytes == 8
                                  : set.bytes == 1 || set.bytes == 2 || set.bytes == 4 || set.bytes == 8;
  if (!usual || load<std::uint16_t>(data, kTypeHead) != 0 ||
      load<std::uint16_t>(data, kTypeHead + 2) != 8 * set.bytes)
    refuse_type("numbers of an unusual kind");
  if (!set.is_float) return;
  const std::uint8_t mantissa = set.bytes == 4 ? 23 : 52;
  if ((flags & 0x40) != 0 || load<std::uint8_t>(data, kTypeHead + 4) != mantissa ||
      load<std::uint8_t>(data, kTypeHead + 7) != mantissa)
    refuse_type("numbers of an unusual kind");
}

/// The number called `member` of a record, which is stored in one piece.
void read_member_type(Bytes data, const std::string& member, Hdf5Dataset& set) {
  const auto head = load<std::uint8_t>(data, 0);
  if ((head & 0x0f) != kRecord) refuse_type("no records where some are expected");
  const int version = head >> 4;
  const auto members = load<std::uint16_t>(data, 1);
  constexpr std::uint32_t kMostRecordBytes = 4096;
  const auto record = load<std::uint32_t>(data, 4);
  if (record == 0 || record > kMostRecordBytes) refuse_type("records of an unusual size");
  ByteCursor cursor(data.subspan(kTypeHead));
  for (std::size_t i = 0; i < members; ++i) {
    std::string name;
    for (char c = cursor.get<char>(); c != 0; c = cursor.get<char>()) name += c;
    if (version < 3) static_cast<void>(cursor.take((8 - (name.size() + 1) % 8) % 8));
    std::uint64_t at = 0;
    if (version < 3) {
      at = cursor.get<std::uint32_t>();
      if (version == 1) static_cast<void>(cursor.take(28));  // dimensions, of no use for numbers
    } else {
      for (std::size_t byte = 0; byte == 0 || record >> (8 * byte) != 0; ++byte)
        at |= std::uint64_t{cursor.get<std::uint8_t>()} << (8 * byte);
    }
    const Bytes type = data.subspan(kTypeHead + cursor.offset());
    const int kind = load<std::uint8_t>(type, 0) & 0x0f;
    if (kind != kInteger && kind != kFloat) refuse_type("records of more than numbers");
    static_cast<void>(cursor.take(kTypeHead + (kind == kInteger ? 4 : 12)));
    if (name != member) continue;
    read_number_type(type, set);
    if (set.big_endian) refuse_type("records of big-endian numbers");
    if (at + set.bytes > record) throw BadBytes{"a number leads outside its record"};
    set.record_bytes = record;
    set.record_at = static_cast<std::size_t>(at);
    return;
  }
  throw UnknownFormat(fmt::format("its records have no '{}'", member));
}

void read_fill_value(const Hdf5Message& message, Hdf5Dataset& set) {
  ByteCursor cursor(message.data);
  constexpr std::uint8_t kDefined = 0x20;
  const auto version = cursor.get<std::uint8_t>();
  const auto flags = cursor.get<std::uint8_t>();
  if (version < 3) static_cast<void>(cursor.get<std::uint8_t>());
  if (version < 3 ? cursor.get<std::uint8_t>() == 0 : (flags & kDefined) == 0) return;
  if (cursor.get<std::uint32_t>() != set.bytes) return;
  const Bytes value = cursor.take(set.bytes);
  set.fill.assign(value.begin(), value.end());
}

std::vector<Hdf5Filter> read_filters(const Hdf5Message& message) {
  ByteCursor cursor(message.data);
  const auto version = cursor.get<std::uint8_t>();
  std::vector<Hdf5Filter> filters(cursor.get<std::uint8_t>());
  if (version == 1) static_cast<void>(cursor.take(6));
  constexpr std::uint16_t kFirstOfOthers = 256;
  for (Hdf5Filter& filter : filters) {
    filter.id = cursor.get<std::uint16_t>();
    const std::size_t name =
        version == 1 || filter.id >= kFirstOfOthers ? cursor.get<std::uint16_t>() : std::size_t{0};
    static_cast<void>(cursor.get<std::uint16_t>());
    const std::size_t values = cursor.get<std::uint16_t>();
    static_cast<void>(cursor.take(version == 1 ? (name + 7) / 8 * 8 : name));
    for (std::size_t i = 0; i < values; ++i) filter.values.push_back(cursor.get<std::uint32_t>());
    if (version == 1 && values % 2 == 1) static_cast<void>(cursor.get<std::uint32_t>());
  }
  return filters;
}

void read_chunks(Hdf5Tables& tables, std::uint64_t tree, std::uint64_t file_size, std::size_t rank,
                 Hdf5Dataset& set) {
  constexpr std::uint8_t kChunkTree = 1;
  std::uint64_t stored = 0;
  walk_hdf5_tree(tables, tree, kChunkTree, 8 * (rank + 2), [&](Bytes key, std::uint64_t address) {
    ByteCursor cursor(key);
    Hdf5Chunk chunk;
    chunk.address = address;
    chunk.size = cursor.get<std::uint32_t>();
    chunk.skipped = cursor.get<std::uint32_t>();
    for (std::size_t i = 0; i < rank; ++i) {
      chunk.at[i] = cursor.get<std::uint64_t>();
      if (chunk.at[i] % set.chunk[i] != 0) throw BadBytes{"its chunks overlap"};
    }
    if (!set.chunks.empty() && set.chunks.back().at >= chunk.at) throw BadBytes{"its chunks have no order"};
    stored += chunk.size;
    if (chunk.size == 0 || stored > file_size) throw BadBytes{"its chunks overlap"};
    set.chunks.push_back(chunk);
  });
}

/// Chunks need not be stored before something is written there. So few bytes could state any number of rows.
void expect_mostly_written(const Hdf5Dataset& set, std::uint64_t file_size) {
  std::uint64_t all = 1;
  for (std::size_t i = 0; i < set.size.size(); ++i) all *= (set.size[i] + set.chunk[i] - 1) / set.chunk[i];
  const auto there = static_cast<std::uint64_t>(
      std::count_if(set.chunks.begin(), set.chunks.end(), [&](const Hdf5Chunk& chunk) {
        return chunk.at[0] < set.size[0] && chunk.at[1] < set.size[1] && chunk.at[2] < set.size[2];
      }));
  constexpr std::uint64_t kAllowed = 1 << 20;
  if (all - there > std::max(file_size, kAllowed) / set.chunk_bytes())
    throw BadBytes{"most of the rows that it states were never written"};
}

void read_layout(Hdf5Tables& tables, const Hdf5Message& message, std::uint64_t file_size, std::size_t rank,
                 Hdf5Dataset& set) {
  ByteCursor cursor(message.data);
  const auto version = cursor.get<std::uint8_t>();
  constexpr std::uint8_t kCompact = 0, kContiguous = 1, kChunked = 2;
  const auto storage = cursor.get<std::uint8_t>();
  // Version 4 differs for chunks alone.
  if (version != 3 && (version != 4 || storage == kChunked)) throw UnknownFormat(kHdf5Unknown);
  if (storage == kCompact) {
    set.storage = Hdf5Dataset::Storage::kCompact;
    const Bytes data = cursor.take(cursor.get<std::uint16_t>());
    set.compact.assign(data.begin(), data.end());
    if (set.size[0] > data.size() / set.row_bytes()) throw BadBytes{"it states more rows than it holds"};
  } else if (storage == kContiguous) {
    set.storage = Hdf5Dataset::Storage::kContiguous;
    set.address = cursor.get<std::uint64_t>();
    const std::uint64_t behind = set.address < file_size ? file_size - set.address : 0;
    if (set.size[0] > behind / set.row_bytes()) throw BadBytes{"it states more rows than it holds"};
  } else if (storage == kChunked) {
    set.storage = Hdf5Dataset::Storage::kChunked;
    if (rank == 0 || cursor.get<std::uint8_t>() != rank + 1) throw BadBytes{"its chunks have another shape"};
    const auto tree = cursor.get<std::uint64_t>();
    std::uint64_t bytes = set.element_bytes();
    for (std::size_t i = 0; i < rank; ++i) {
      set.chunk[i] = cursor.get<std::uint32_t>();
      if (set.chunk[i] == 0 || set.chunk[i] > kLargestChunk / bytes)
        throw BadBytes{"its chunks have no size, or are too large"};
      bytes *= set.chunk[i];
    }
    if (set.chunk[0] > kLargestChunk / set.row_bytes()) throw BadBytes{"its chunks are too large"};
    if (tree != kHdf5Undefined) read_chunks(tables, tree, file_size, rank, set);
    expect_mostly_written(set, file_size);
  } else {
    throw UnknownFormat(kHdf5Unknown);
  }
}

}  // namespace

Hdf5Dataset read_hdf5_dataset(const RandomFile& file, std::uint64_t address, const std::string& member) {
  Hdf5Tables tables(file);
  const auto messages = read_hdf5_header(tables, address);
  const Hdf5Message *space = find_message(messages, Hdf5Message::kDataspace),
                    *type = find_message(messages, Hdf5Message::kDatatype),
                    *layout = find_message(messages, Hdf5Message::kDataLayout);
  if (space == nullptr || type == nullptr || layout == nullptr) throw BadBytes{"it is no data set"};
  Hdf5Dataset set;
  std::size_t rank = 0;
  read_dataspace(*space, set, rank);
  member.empty() ? read_number_type(type->data, set) : read_member_type(type->data, member, set);
  if (const Hdf5Message* fill = find_message(messages, Hdf5Message::kFillValue)) read_fill_value(*fill, set);
  if (const Hdf5Message* filters = find_message(messages, Hdf5Message::kFilterPipeline))
    set.filters = read_filters(*filters);
  read_layout(tables, *layout, file.size(), rank, set);
  return set;
}

}  // namespace idol
