#include "idol/io/hdf5_tables.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

#include "idol/io/bytes.hpp"

namespace idol {
namespace {

// The names of the HDF5 File Format Specification, version 3.0.
enum MessageType : std::uint16_t {
  kDataspace = 0x01,
  kDatatype = 0x03,
  kFillValue = 0x05,
  kLinkInfo = 0x02,
  kLink = 0x06,
  kDataLayout = 0x08,
  kFilterPipeline = 0x0b,
  kContinuation = 0x10,
  kSymbolTable = 0x11,
};

constexpr std::uint64_t kUndefined = std::numeric_limits<std::uint64_t>::max();
constexpr std::uint64_t kLargestChunk = 1U << 30;
constexpr const char* kOtherLink = "a link to a path or another file is not known here";
constexpr const char* kUnknown = "it is stored in a way that is not known here (docs/formats.md)";

/// The tables of a file share no bytes: so one search through them reads no more than the file has. That ends
/// tables that lead back to themselves.
class Tables {
 public:
  explicit Tables(const RandomFile& file) : file_(file), left_(file.size()) {}

  [[nodiscard]] std::vector<std::uint8_t> read(std::uint64_t address, std::uint64_t size) {
    if (address > file_.size() || size > file_.size() - address)
      throw BadBytes{"an address leads outside the file"};
    if (size > left_) throw BadBytes{"its tables lead back to themselves"};
    left_ -= size;
    std::vector<std::uint8_t> bytes;
    file_.read(address, static_cast<std::size_t>(size), bytes);
    return bytes;
  }

 private:
  const RandomFile& file_;
  std::uint64_t left_;
};

void expect_signature(ByteCursor& cursor, std::string_view signature) {
  if (std::memcmp(cursor.take(signature.size()).data(), signature.data(), signature.size()) != 0)
    throw BadBytes{"an address leads to something else"};
}

/// A little-endian number of `bytes` bytes, up to 8.
std::uint64_t get_number(ByteCursor& cursor, std::size_t bytes) {
  const Bytes part = cursor.take(bytes);
  std::uint64_t value = 0;
  std::copy(part.begin(), part.end(), reinterpret_cast<std::uint8_t*>(&value));
  return value;
}

struct Message {
  std::uint16_t type = 0;
  std::uint8_t flags = 0;
  std::vector<std::uint8_t> data;
};

/// The messages of an object header, of version 1 or 2.
std::vector<Message> read_header(Tables& tables, std::uint64_t address) {
  std::vector<std::uint8_t> start = tables.read(address, 6);
  const bool second = start[0] == 'O' && start[1] == 'H' && start[2] == 'D' && start[3] == 'R';
  if (second ? start[4] != 2 : start[0] != 1) throw BadBytes{"an address leads to something else"};
  const std::uint8_t flags = second ? start[5] : 0;
  constexpr std::uint8_t kSizeBytes = 0x03, kOrdered = 0x04, kPhases = 0x10, kTimes = 0x20;
  const std::size_t before_size = !second ? 2 : ((flags & kPhases) ? 4 : 0) + ((flags & kTimes) ? 16 : 0);
  const std::size_t size_bytes = second ? std::size_t{1} << (flags & kSizeBytes) : 4;
  const std::size_t padding = second ? 0 : 4;
  const std::vector<std::uint8_t> prefix =
      tables.read(address + start.size(), before_size + size_bytes + padding);
  ByteCursor cursor(prefix);
  static_cast<void>(cursor.take(before_size));
  const std::uint64_t size = get_number(cursor, size_bytes);

  std::vector<Message> messages;
  std::vector<std::vector<std::uint8_t>> blocks{tables.read(address + start.size() + prefix.size(), size)};
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::vector<std::uint8_t> block = std::move(blocks[b]);
    ByteCursor in(block);
    const bool continued = b > 0 && second;
    const std::size_t checksum = continued ? 4 : 0, head = !second ? 8 : (flags & kOrdered) ? 6 : 4;
    if (continued) expect_signature(in, "OCHK");
    while (in.left() >= head + checksum) {
      Message message;
      message.type = second ? in.get<std::uint8_t>() : in.get<std::uint16_t>();
      const auto length = in.get<std::uint16_t>();
      message.flags = in.get<std::uint8_t>();
      static_cast<void>(in.take(head - (second ? 4 : 5)));
      const Bytes data = in.take(length);
      message.data.assign(data.begin(), data.end());
      if (message.type == kContinuation) {
        ByteCursor where(data);
        const auto next = where.get<std::uint64_t>();
        blocks.push_back(tables.read(next, where.get<std::uint64_t>()));
      } else if (message.type <= kSymbolTable) {
        messages.push_back(std::move(message));
      }
    }
  }
  return messages;
}

const Message* find(const std::vector<Message>& messages, std::uint16_t type) {
  const auto found = std::find_if(messages.begin(), messages.end(),
                                  [&](const Message& message) { return message.type == type; });
  if (found == messages.end()) return nullptr;
  constexpr std::uint8_t kShared = 0x02;
  if ((found->flags & kShared) != 0) throw BadBytes{kUnknown};
  return &*found;
}

/// Calls `take(key, address)` for each child of the lowest nodes of a B-tree of version 1, in the order of
/// keys.
template <class Take>
void walk_tree(Tables& tables, std::uint64_t address, std::uint8_t type, std::size_t key_bytes,
               const Take& take, int level = -1) {
  constexpr std::size_t kHead = 24;
  const auto head = tables.read(address, kHead);
  ByteCursor cursor(head);
  expect_signature(cursor, "TREE");
  if (cursor.get<std::uint8_t>() != type) throw BadBytes{"an address leads to something else"};
  const int own_level = cursor.get<std::uint8_t>();
  if (level >= 0 && own_level != level) throw BadBytes{"a tree has no order"};
  const auto count = cursor.get<std::uint16_t>();
  const auto body = tables.read(address + kHead, count * (key_bytes + sizeof(std::uint64_t)));
  ByteCursor children(body);
  for (std::size_t i = 0; i < count; ++i) {
    const Bytes key = children.take(key_bytes);
    const auto child = children.get<std::uint64_t>();
    if (own_level == 0)
      take(key, child);
    else
      walk_tree(tables, child, type, key_bytes, take, own_level - 1);
  }
}

/// A group as HDF5 before 1.8 has it and still writes by default: a tree of names that lie in a heap.
std::optional<std::uint64_t> find_symbol(Tables& tables, const Message& table, std::string_view name) {
  constexpr std::size_t kHeapHead = 32, kSymbolHead = 8, kSymbolBytes = 40;
  ByteCursor addresses(table.data);
  const auto tree = addresses.get<std::uint64_t>(), heap = addresses.get<std::uint64_t>();
  const auto heap_head = tables.read(heap, kHeapHead);
  ByteCursor in(heap_head);
  expect_signature(in, "HEAP");
  const auto names = tables.read(load<std::uint64_t>(heap_head, 24), load<std::uint64_t>(heap_head, 8));
  std::optional<std::uint64_t> found;
  constexpr std::uint8_t kGroupTree = 0;
  walk_tree(tables, tree, kGroupTree, sizeof(std::uint64_t), [&](Bytes, std::uint64_t node) {
    const auto head = tables.read(node, kSymbolHead);
    ByteCursor cursor(head);
    expect_signature(cursor, "SNOD");
    const std::size_t count = load<std::uint16_t>(head, 6);
    const auto symbols = tables.read(node + kSymbolHead, count * kSymbolBytes);
    for (std::size_t at = 0; at < symbols.size(); at += kSymbolBytes) {
      const auto offset = load<std::uint64_t>(symbols, at);
      if (offset > names.size() || name.size() >= names.size() - offset) continue;
      const auto* text = names.data() + offset;
      if (text[name.size()] == 0 && std::memcmp(text, name.data(), name.size()) == 0)
        found = load<std::uint64_t>(symbols, at + 8);
      if (found == kUndefined) throw BadBytes{kOtherLink};
    }
  });
  return found;
}

/// The address of a hard link, if it has this name.
std::optional<std::uint64_t> read_link(const Message& link, std::string_view name) {
  constexpr std::uint8_t kLengthBytes = 0x03, kOrder = 0x04, kType = 0x08, kCharacters = 0x10;
  ByteCursor cursor(link.data);
  static_cast<void>(cursor.get<std::uint8_t>());
  const auto flags = cursor.get<std::uint8_t>();
  const std::uint8_t type = (flags & kType) ? cursor.get<std::uint8_t>() : std::uint8_t{0};
  static_cast<void>(cursor.take(((flags & kOrder) ? 8 : 0) + ((flags & kCharacters) ? 1 : 0)));
  const std::uint64_t length = get_number(cursor, std::size_t{1} << (flags & kLengthBytes));
  const Bytes text = cursor.take(static_cast<std::size_t>(length));
  if (!std::equal(text.begin(), text.end(), name.begin(), name.end())) return std::nullopt;
  if (type != 0) throw BadBytes{kOtherLink};
  return cursor.get<std::uint64_t>();
}

std::optional<std::uint64_t> find_in_group(Tables& tables, std::uint64_t group, std::string_view name) {
  const auto messages = read_header(tables, group);
  if (const Message* table = find(messages, kSymbolTable)) return find_symbol(tables, *table, name);
  for (const Message& message : messages)
    if (message.type == kLink)
      if (const auto found = read_link(message, name)) return found;
  if (const Message* info = find(messages, kLinkInfo)) {
    const std::size_t heap = (load<std::uint8_t>(info->data, 1) & 1) ? 10 : 2;
    if (load<std::uint64_t>(info->data, heap) != kUndefined) throw BadBytes{kUnknown};
  }
  return std::nullopt;
}

void read_dataspace(const Message& message, Hdf5Dataset& set, std::size_t& rank) {
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

void read_datatype(Bytes data, Hdf5Dataset& set) {
  constexpr int kInteger = 0, kFloat = 1, kEnum = 8;
  constexpr std::size_t kHead = 8;
  int kind = load<std::uint8_t>(data, 0) & 0x0f;
  if (kind == kEnum) {  // h5py's booleans
    data = data.subspan(std::min(kHead, data.size()));
    kind = load<std::uint8_t>(data, 0) & 0x0f;
    if (kind != kInteger) throw BadBytes{"it does not hold numbers"};
  }
  if (kind != kInteger && kind != kFloat) throw BadBytes{"it does not hold numbers"};
  const auto flags = load<std::uint8_t>(data, 1);
  set.bytes = load<std::uint32_t>(data, 4);
  set.is_float = kind == kFloat;
  set.big_endian = (flags & 0x01) != 0;
  set.is_signed = (flags & 0x08) != 0;
  const bool usual = set.is_float ? set.bytes == 4 || set.bytes == 8
                                  : set.bytes == 1 || set.bytes == 2 || set.bytes == 4 || set.bytes == 8;
  if (!usual || load<std::uint16_t>(data, kHead) != 0 ||
      load<std::uint16_t>(data, kHead + 2) != 8 * set.bytes)
    throw BadBytes{"its numbers are of a kind that is not known here"};
  if (!set.is_float) return;
  const std::uint8_t mantissa = set.bytes == 4 ? 23 : 52;
  if ((flags & 0x40) != 0 || load<std::uint8_t>(data, kHead + 4) != mantissa ||
      load<std::uint8_t>(data, kHead + 7) != mantissa)
    throw BadBytes{"its numbers are of a kind that is not known here"};
}

void read_fill_value(const Message& message, Hdf5Dataset& set) {
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

std::vector<Hdf5Filter> read_filters(const Message& message) {
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

void read_chunks(Tables& tables, std::uint64_t tree, std::uint64_t file_size, std::size_t rank,
                 Hdf5Dataset& set) {
  constexpr std::uint8_t kChunkTree = 1;
  std::uint64_t stored = 0;
  walk_tree(tables, tree, kChunkTree, 8 * (rank + 2), [&](Bytes key, std::uint64_t address) {
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

void read_layout(Tables& tables, const Message& message, std::uint64_t file_size, std::size_t rank,
                 Hdf5Dataset& set) {
  ByteCursor cursor(message.data);
  const auto version = cursor.get<std::uint8_t>();
  constexpr std::uint8_t kCompact = 0, kContiguous = 1, kChunked = 2;
  const auto storage = cursor.get<std::uint8_t>();
  // Version 4 differs for chunks alone.
  if (version != 3 && (version != 4 || storage == kChunked)) throw BadBytes{kUnknown};
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
    std::uint64_t bytes = set.bytes;
    for (std::size_t i = 0; i < rank; ++i) {
      set.chunk[i] = cursor.get<std::uint32_t>();
      if (set.chunk[i] == 0 || set.chunk[i] > kLargestChunk / bytes)
        throw BadBytes{"its chunks have no size, or are too large"};
      bytes *= set.chunk[i];
    }
    if (set.chunk[0] > kLargestChunk / set.row_bytes()) throw BadBytes{"its chunks are too large"};
    if (tree != kUndefined) read_chunks(tables, tree, file_size, rank, set);
    expect_mostly_written(set, file_size);
  } else {
    throw BadBytes{kUnknown};
  }
}

}  // namespace

std::uint64_t hdf5_root(const RandomFile& file) {
  constexpr std::uint64_t kMost = 128;
  std::vector<std::uint8_t> start;
  file.read(0, static_cast<std::size_t>(std::min(kMost, file.size())), start);
  ByteCursor cursor(start);
  expect_signature(cursor, "\x89HDF\r\n\x1a\n");
  const auto version = cursor.get<std::uint8_t>();
  if (version > 3) throw BadBytes{kUnknown};
  const bool tables = version < 2;  // where the later versions have less
  if (load<std::uint16_t>(start, tables ? 13 : 9) != 0x0808) throw BadBytes{kUnknown};
  constexpr std::uint8_t kOpenForWriting = 0x01 | 0x04;
  if (version == 3 && (load<std::uint8_t>(start, 11) & kOpenForWriting) != 0)
    throw BadBytes{"it was never closed"};
  const std::size_t base = tables ? (version == 0 ? 24 : 28) : 12;
  const std::size_t end = base + 16;
  const std::size_t root = tables ? base + 40 : base + 24;
  if (load<std::uint64_t>(start, base) != 0 || load<std::uint64_t>(start, end) > file.size())
    throw BadBytes{"it is cut off"};
  return load<std::uint64_t>(start, root);
}

std::optional<std::uint64_t> find_hdf5_object(const RandomFile& file, std::uint64_t root,
                                              const std::string& path) {
  Tables tables(file);
  std::optional<std::uint64_t> found = root;
  for (std::size_t begin = 0; found && begin <= path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    found = find_in_group(tables, *found, std::string_view(path).substr(begin, end - begin));
    begin = end + 1;
  }
  return found;
}

Hdf5Dataset read_hdf5_dataset(const RandomFile& file, std::uint64_t address) {
  Tables tables(file);
  const auto messages = read_header(tables, address);
  const Message *space = find(messages, kDataspace), *type = find(messages, kDatatype),
                *layout = find(messages, kDataLayout);
  if (space == nullptr || type == nullptr || layout == nullptr) throw BadBytes{"it is no data set"};
  Hdf5Dataset set;
  std::size_t rank = 0;
  read_dataspace(*space, set, rank);
  read_datatype(type->data, set);
  if (const Message* fill = find(messages, kFillValue)) read_fill_value(*fill, set);
  if (const Message* filters = find(messages, kFilterPipeline)) set.filters = read_filters(*filters);
  read_layout(tables, *layout, file.size(), rank, set);
  return set;
}

}  // namespace idol
