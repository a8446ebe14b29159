// The tables of an HDF5 file: object headers, trees and groups. What data sets make of them is in
// hdf5_dataset.
//
// Read by code of this project, since the HDF5 library crashes on damaged files: every address, size and
// count is checked before use, and the work is bounded by the size of the file.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "idol/io/bytes.hpp"
#include "idol/io/random_file.hpp"

namespace idol {

constexpr std::uint64_t kHdf5Undefined = std::numeric_limits<std::uint64_t>::max();
constexpr const char* kHdf5Unknown = "it is stored in a way that is not known here (docs/formats.md)";

/// The tables of a file share no bytes: so one search through them reads no more than the file has. That ends
/// tables that lead back to themselves.
class Hdf5Tables {
 public:
  explicit Hdf5Tables(const RandomFile& file) : file_(file), left_(file.size()) {}

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

struct Hdf5Message {
  // The names of the HDF5 File Format Specification, version 3.0.
  enum Type : std::uint16_t {
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

  std::uint16_t type = 0;
  std::uint8_t flags = 0;
  std::vector<std::uint8_t> data;
};

/// The messages of an object header, of version 1 or 2. Throws BadBytes on damage.
std::vector<Hdf5Message> read_hdf5_header(Hdf5Tables& tables, std::uint64_t address);

/// The first of this type; null if there is none. Throws BadBytes if it is shared with another object.
const Hdf5Message* find_message(const std::vector<Hdf5Message>& messages, std::uint16_t type);

/// Throws BadBytes if something else follows.
void expect_hdf5_signature(ByteCursor& cursor, std::string_view signature);

/// Calls `take(key, address)` for each child of the lowest nodes of a B-tree of version 1, in the order of
/// keys.
template <class Take>
void walk_hdf5_tree(Hdf5Tables& tables, std::uint64_t address, std::uint8_t type, std::size_t key_bytes,
                    const Take& take, int level = -1) {
  constexpr std::size_t kHead = 24;
  const auto head = tables.read(address, kHead);
  ByteCursor cursor(head);
  expect_hdf5_signature(cursor, "TREE");
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
      walk_hdf5_tree(tables, child, type, key_bytes, take, own_level - 1);
  }
}

/// The address of the root group. Throws BadBytes if this is no HDF5 file, or one that is cut off.
std::uint64_t hdf5_root(const RandomFile& file);

/// The address of what `path`, "group/name", names below the group at `root`; none if there is nothing.
/// Throws BadBytes on damage.
std::optional<std::uint64_t> find_hdf5_object(const RandomFile& file, std::uint64_t root,
                                              const std::string& path);

}  // namespace idol
