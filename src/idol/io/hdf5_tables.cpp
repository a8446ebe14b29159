#include "idol/io/hdf5_tables.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

namespace idol {
namespace {

constexpr const char* kOtherLink = "a link to a path or another file is not known here";

/// A little-endian number of `bytes` bytes, up to 8.
std::uint64_t get_number(ByteCursor& cursor, std::size_t bytes) {
  const Bytes part = cursor.take(bytes);
  std::uint64_t value = 0;
  std::copy(part.begin(), part.end(), reinterpret_cast<std::uint8_t*>(&value));
  return value;
}

}  // namespace

void expect_hdf5_signature(ByteCursor& cursor, std::string_view signature) {
  if (std::memcmp(cursor.take(signature.size()).data(), signature.data(), signature.size()) != 0)
    throw BadBytes{"an address leads to something else"};
}

std::vector<Hdf5Message> read_hdf5_header(Hdf5Tables& tables, std::uint64_t address) {
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

  std::vector<Hdf5Message> messages;
  std::vector<std::vector<std::uint8_t>> blocks{tables.read(address + start.size() + prefix.size(), size)};
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::vector<std::uint8_t> block = std::move(blocks[b]);
    ByteCursor in(block);
    const bool continued = b > 0 && second;
    const std::size_t checksum = continued ? 4 : 0, head = !second ? 8 : (flags & kOrdered) ? 6 : 4;
    if (continued) expect_hdf5_signature(in, "OCHK");
    while (in.left() >= head + checksum) {
      Hdf5Message message;
      message.type = second ? in.get<std::uint8_t>() : in.get<std::uint16_t>();
      const auto length = in.get<std::uint16_t>();
      message.flags = in.get<std::uint8_t>();
      static_cast<void>(in.take(head - (second ? 4 : 5)));
      const Bytes data = in.take(length);
      message.data.assign(data.begin(), data.end());
      if (message.type == Hdf5Message::kContinuation) {
        ByteCursor where(data);
        const auto next = where.get<std::uint64_t>();
        blocks.push_back(tables.read(next, where.get<std::uint64_t>()));
      } else if (message.type <= Hdf5Message::kSymbolTable) {
        messages.push_back(std::move(message));
      }
    }
  }
  return messages;
}

const Hdf5Message* find_message(const std::vector<Hdf5Message>& messages, std::uint16_t type) {
  const auto found = std::find_if(messages.begin(), messages.end(),
                                  [&](const Hdf5Message& message) { return message.type == type; });
  if (found == messages.end()) return nullptr;
  constexpr std::uint8_t kShared = 0x02;
  if ((found->flags & kShared) != 0) throw UnknownFormat(kHdf5Unknown);
  return &*found;
}

namespace {

/// A group as HDF5 before 1.8 has it and still writes by default: a tree of names that lie in a heap.
std::optional<std::uint64_t> find_symbol(Hdf5Tables& tables, const Hdf5Message& table,
                                         std::string_view name) {
  constexpr std::size_t kHeapHead = 32, kSymbolHead = 8, kSymbolBytes = 40;
  ByteCursor addresses(table.data);
  const auto tree = addresses.get<std::uint64_t>(), heap = addresses.get<std::uint64_t>();
  const auto heap_head = tables.read(heap, kHeapHead);
  ByteCursor in(heap_head);
  expect_hdf5_signature(in, "HEAP");
  const auto names = tables.read(load<std::uint64_t>(heap_head, 24), load<std::uint64_t>(heap_head, 8));
  std::optional<std::uint64_t> found;
  constexpr std::uint8_t kGroupTree = 0;
  walk_hdf5_tree(tables, tree, kGroupTree, sizeof(std::uint64_t), [&](Bytes, std::uint64_t node) {
    const auto head = tables.read(node, kSymbolHead);
    ByteCursor cursor(head);
    expect_hdf5_signature(cursor, "SNOD");
    const std::size_t count = load<std::uint16_t>(head, 6);
    const auto symbols = tables.read(node + kSymbolHead, count * kSymbolBytes);
    for (std::size_t at = 0; at < symbols.size(); at += kSymbolBytes) {
      const auto offset = load<std::uint64_t>(symbols, at);
      if (offset > names.size() || name.size() >= names.size() - offset) continue;
      const auto* text = names.data() + offset;
      if (text[name.size()] == 0 && std::memcmp(text, name.data(), name.size()) == 0)
        found = load<std::uint64_t>(symbols, at + 8);
      if (found == kHdf5Undefined) throw UnknownFormat(kOtherLink);
    }
  });
  return found;
}

/// The address of a hard link, if it has this name.
std::optional<std::uint64_t> read_link(const Hdf5Message& link, std::string_view name) {
  constexpr std::uint8_t kLengthBytes = 0x03, kOrder = 0x04, kType = 0x08, kCharacters = 0x10;
  ByteCursor cursor(link.data);
  static_cast<void>(cursor.get<std::uint8_t>());
  const auto flags = cursor.get<std::uint8_t>();
  const std::uint8_t type = (flags & kType) ? cursor.get<std::uint8_t>() : std::uint8_t{0};
  static_cast<void>(cursor.take(((flags & kOrder) ? 8 : 0) + ((flags & kCharacters) ? 1 : 0)));
  const std::uint64_t length = get_number(cursor, std::size_t{1} << (flags & kLengthBytes));
  const Bytes text = cursor.take(static_cast<std::size_t>(length));
  if (!std::equal(text.begin(), text.end(), name.begin(), name.end())) return std::nullopt;
  if (type != 0) throw UnknownFormat(kOtherLink);
  return cursor.get<std::uint64_t>();
}

std::optional<std::uint64_t> find_in_group(Hdf5Tables& tables, std::uint64_t group, std::string_view name) {
  const auto messages = read_hdf5_header(tables, group);
  if (const Hdf5Message* table = find_message(messages, Hdf5Message::kSymbolTable))
    return find_symbol(tables, *table, name);
  for (const Hdf5Message& message : messages)
    if (message.type == Hdf5Message::kLink)
      if (const auto found = read_link(message, name)) return found;
  if (const Hdf5Message* info = find_message(messages, Hdf5Message::kLinkInfo)) {
    const std::size_t heap = (load<std::uint8_t>(info->data, 1) & 1) ? 10 : 2;
    if (load<std::uint64_t>(info->data, heap) != kHdf5Undefined) throw UnknownFormat(kHdf5Unknown);
  }
  return std::nullopt;
}

}  // namespace

std::uint64_t hdf5_root(const RandomFile& file) {
  constexpr std::uint64_t kMost = 128;
  std::vector<std::uint8_t> start;
  file.read(0, static_cast<std::size_t>(std::min(kMost, file.size())), start);
  ByteCursor cursor(start);
  expect_hdf5_signature(cursor, "\x89HDF\r\n\x1a\n");
  const auto version = cursor.get<std::uint8_t>();
  if (version > 3) throw UnknownFormat(kHdf5Unknown);
  const bool tables = version < 2;  // where the later versions have less
  if (load<std::uint16_t>(start, tables ? 13 : 9) != 0x0808) throw UnknownFormat(kHdf5Unknown);
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
  Hdf5Tables tables(file);
  std::optional<std::uint64_t> found = root;
  for (std::size_t begin = 0; found && begin <= path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    found = find_in_group(tables, *found, std::string_view(path).substr(begin, end - begin));
    begin = end + 1;
  }
  return found;
}

}  // namespace idol
