// The container of a ROS 1 bag (version 2.0): connections and messages, not what is in them.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "idol/base/diagnostics.hpp"
#include "idol/io/bytes.hpp"
#include "idol/io/random_file.hpp"

namespace idol {

struct BagTopic {
  std::string name;
  std::string type;                ///< package/Message
  std::string md5sum, definition;  ///< of the type, as the bag's recorder knew it
  std::set<std::uint32_t> connections;
  std::int64_t messages = -1;  ///< -1: not known, the bag has no index
};

/// What a bag holds. With an index it is read from there; without one (the recorder was killed, the file is
/// cut off) the whole file is walked through once, as far as it is good.
class BagFile {
 public:
  /// Throws DataError if this is no bag of version 2.0, or an encrypted one.
  explicit BagFile(const std::filesystem::path& path);

  [[nodiscard]] const RandomFile& file() const { return file_; }
  [[nodiscard]] const std::vector<BagTopic>& topics() const { return topics_; }
  [[nodiscard]] bool indexed() const { return indexed_; }

 private:
  friend class BagMessages;
  void read_index(std::uint64_t position, std::uint32_t connections, std::uint32_t chunks);
  void walk();
  void add_connection(Bytes header, Bytes data);

  RandomFile file_;
  std::uint64_t begin_ = 0;  // of the first record behind the bag's header
  std::vector<BagTopic> topics_;
  bool indexed_ = false;
  std::map<std::uint64_t, std::set<std::uint32_t>> chunks_;  // by place, the connections in it; indexed only
};

/// The messages of some connections from front to back, in bounded memory (one chunk).
class BagMessages {
 public:
  struct Message {
    std::uint32_t connection = 0;
    Bytes data;  ///< valid until the next call
  };

  BagMessages(const BagFile& bag, std::set<std::uint32_t> connections);
  /// False at the end. Throws DataError on damage, after every message before it was given out.
  bool next(Message& message);
  /// Place in the file of the last message, or of the chunk that holds it.
  [[nodiscard]] std::uint64_t place() const { return place_; }
  [[nodiscard]] double progress() const;

 private:
  friend class BagFile;
  /// A record: its header's fields and its data, valid until the next one is read.
  struct Record {
    int op = -1;
    Bytes header, data;
  };
  bool next_record(Record& record);
  bool next_in_file(Record& record);
  void open_chunk(Bytes header, std::uint64_t data_at, std::uint32_t size);
  [[nodiscard]] bool unwanted_chunk(std::uint64_t at) const;

  const BagFile& bag_;
  std::set<std::uint32_t> connections_;
  std::uint64_t at_;         // of the next record in the file
  std::uint64_t place_ = 0;  // of the record in the file being read
  std::vector<std::uint8_t> header_, data_, chunk_;
  std::size_t in_chunk_ = 0;  // of the next record in the chunk
};

}  // namespace idol
