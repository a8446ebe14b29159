#include "idol/io/bag_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "idol/io/block_codec.hpp"

namespace idol {
namespace {

constexpr std::string_view kBagMagic = "#ROSBAG V2.0\n";
constexpr std::size_t kBagLargestHeader = 1 << 20;
constexpr std::uint32_t kLargestRecord = 1U << 30;
constexpr int kMessage = 2, kBagHeader = 3, kChunk = 5, kChunkInfo = 6, kConnection = 7;

/// The value of a field of a record's header; nothing if it has no such field. Throws BadBytes.
std::optional<Bytes> find_field(Bytes header, std::string_view name) {
  ByteCursor cursor(header);
  while (cursor.left() > 0) {
    const std::string_view field = cursor.text();
    const auto equals = field.find('=');
    if (equals == std::string_view::npos) throw BadBytes{"a field of its header has no '='"};
    if (field.substr(0, equals) != name) continue;
    const auto* value = reinterpret_cast<const std::uint8_t*>(field.data() + equals + 1);
    return Bytes(value, field.size() - equals - 1);
  }
  return std::nullopt;
}

Bytes field(Bytes header, std::string_view name) {
  const auto value = find_field(header, name);
  if (!value) throw BadBytes{"its header lacks a field"};
  return *value;
}

template <class T>
T number(Bytes header, std::string_view name) {
  return load<T>(field(header, name), 0);
}

std::string text(Bytes bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace

BagFile::BagFile(const std::filesystem::path& path) : file_(path) {
  std::vector<std::uint8_t> bytes;
  file_.read(0, std::min<std::uint64_t>(kBagMagic.size(), file_.size()), bytes);
  if (text(bytes) != kBagMagic)
    throw DataError(
        fmt::format("{}: a bag of version 2.0 is expected ('rosbag migrate' makes one of older "
                    "ones)",
                    file_.name()));
  begin_ = kBagMagic.size();
  BagMessages records(*this, {});
  BagMessages::Record record;
  try {
    if (records.next_in_file(record) && record.op == kBagHeader) {
      if (const auto encryptor = find_field(record.header, "encryptor"); encryptor && !encryptor->empty())
        throw DataError(fmt::format("{}: the bag is encrypted; 'rosbag decrypt' it first", file_.name()));
      const auto position = number<std::uint64_t>(record.header, "index_pos");
      begin_ = records.at_;
      if (position != 0 && position < file_.size())
        read_index(position, number<std::uint32_t>(record.header, "conn_count"),
                   number<std::uint32_t>(record.header, "chunk_count"));
    }
  } catch (const BadBytes& e) {
    throw file_.damaged(records.place(), "the bag's header", e.why);
  }
  if (!indexed_) walk();
}

void BagFile::read_index(std::uint64_t position, std::uint32_t connections, std::uint32_t chunks) {
  BagMessages records(*this, {});
  records.at_ = position;
  BagMessages::Record record;
  std::map<std::uint32_t, std::int64_t> counts;
  std::uint32_t seen_connections = 0;
  try {
    while (records.next_in_file(record)) {
      if (record.op == kConnection) {
        add_connection(record.header, record.data);
        ++seen_connections;
      } else if (record.op == kChunkInfo) {
        auto& inside = chunks_[number<std::uint64_t>(record.header, "chunk_pos")];
        ByteCursor list(record.data);
        for (auto n = number<std::uint32_t>(record.header, "count"); n > 0; --n) {
          const auto connection = list.get<std::uint32_t>();
          counts[connection] += list.get<std::uint32_t>();
          inside.insert(connection);
        }
      }
    }
    indexed_ = seen_connections == connections && chunks_.size() == chunks;
  } catch (const BadBytes&) {
    // As good as none.
  } catch (const DataError&) {
  }
  if (!indexed_) {
    topics_.clear();
    chunks_.clear();
    return;
  }
  for (BagTopic& topic : topics_) {
    topic.messages = 0;
    for (const std::uint32_t connection : topic.connections) topic.messages += counts[connection];
  }
}

void BagFile::walk() {
  BagMessages records(*this, {});
  try {
    for (BagMessages::Record record; records.next_record(record);)
      if (record.op == kConnection) add_connection(record.header, record.data);
  } catch (const BadBytes&) {
    // Whoever reads the messages comes to the same place, and says so.
  } catch (const DataError&) {
  }
}

void BagFile::add_connection(Bytes header, Bytes data) {
  const auto id = number<std::uint32_t>(header, "conn");
  const std::string topic = text(field(header, "topic"));
  const std::string type = text(field(data, "type"));
  const auto stated = [&](const char* name) {
    const auto bytes = find_field(data, name);
    return bytes ? text(*bytes) : std::string();
  };
  const std::string md5sum = stated("md5sum");
  const auto known = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& t) {
    return t.name == topic && t.type == type && t.md5sum == md5sum;
  });
  if (known != topics_.end()) {
    known->connections.insert(id);
  } else {
    topics_.push_back({topic, type, md5sum, stated("message_definition"), {id}, -1});
  }
}

BagMessages::BagMessages(const BagFile& bag, std::set<std::uint32_t> connections)
    : bag_(bag), connections_(std::move(connections)), at_(bag.begin_) {}

bool BagMessages::unwanted_chunk(std::uint64_t at) const {
  const auto chunk = bag_.chunks_.find(at);
  if (chunk == bag_.chunks_.end()) return false;
  return std::none_of(chunk->second.begin(), chunk->second.end(),
                      [&](std::uint32_t c) { return connections_.contains(c); });
}

/// The next record of the file itself; chunks' data and those of records of no use are left where they are.
bool BagMessages::next_in_file(Record& record) {
  const RandomFile& file = bag_.file_;
  if (at_ == file.size()) return false;
  place_ = at_;
  const auto length = [&](std::uint64_t at, const char* of, std::size_t most) {
    file.read(at, 4, data_);
    const auto size = load<std::uint32_t>(data_, 0);
    if (size > most) throw file.damaged(place_, "a record", of);
    return size;
  };
  const auto header_size = length(at_, "its header would be longer than any", kBagLargestHeader);
  file.read(at_ + 4, header_size, header_);
  const auto data_size = length(at_ + 4 + header_size, "it would be longer than any", kLargestRecord);
  const std::uint64_t data_at = at_ + 8 + header_size;
  record = {number<std::uint8_t>(header_, "op"), header_, {}};
  at_ = data_at + data_size;
  if (record.op == kChunk) {
    if (unwanted_chunk(place_)) return true;
    open_chunk(header_, data_at, data_size);
  } else if (record.op == kMessage || record.op == kConnection || record.op == kChunkInfo) {
    file.read(data_at, data_size, data_);
    record.data = data_;
  } else if (at_ > file.size()) {
    file.read(data_at, data_size, data_);  // says that it is cut off
  }
  return true;
}

void BagMessages::open_chunk(Bytes header, std::uint64_t data_at, std::uint32_t size) {
  const std::string compression = text(field(header, "compression"));
  const auto bytes = std::min<std::size_t>(number<std::uint32_t>(header, "size"), kLargestRecord);
  in_chunk_ = 0;
  if (compression == "none") {
    // Of one that is cut off, the messages before the cut are good.
    const std::uint64_t there = bag_.file_.size() - std::min(data_at, bag_.file_.size());
    return bag_.file_.read(data_at, std::min<std::uint64_t>(size, there), chunk_);
  }
  if (compression != "bz2" && compression != "lz4")
    throw DataError(fmt::format("{}: chunk compressed with '{}'; none, bz2 and lz4 are known",
                                bag_.file_.where(place_), printable(compression)));
  bag_.file_.read(data_at, size, data_);
  try {
    decompress(compression == "lz4" ? BlockCodec::kLz4 : BlockCodec::kBzip2, data_, bytes, chunk_);
  } catch (const BadBytes&) {
    chunk_.clear();
    throw;
  }
}

bool BagMessages::next_record(Record& record) {
  if (in_chunk_ >= chunk_.size()) return next_in_file(record);
  ByteCursor cursor(Bytes(chunk_).subspan(in_chunk_));
  const std::size_t at = std::exchange(in_chunk_, chunk_.size());  // on damage the chunk is over
  record.header = cursor.take(cursor.get<std::uint32_t>());
  record.data = cursor.take(cursor.get<std::uint32_t>());
  record.op = number<std::uint8_t>(record.header, "op");
  in_chunk_ = at + cursor.offset();
  return true;
}

bool BagMessages::next(Message& message) {
  try {
    for (Record record; next_record(record);) {
      if (record.op != kMessage) continue;
      message = {number<std::uint32_t>(record.header, "conn"), record.data};
      if (connections_.contains(message.connection)) return true;
    }
  } catch (const BadBytes& e) {
    throw bag_.file_.damaged(place_, "the record", e.why);
  }
  return false;
}

double BagMessages::progress() const {
  return static_cast<double>(at_) / static_cast<double>(bag_.file_.size());
}

}  // namespace idol
