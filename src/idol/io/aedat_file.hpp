// The container of an iniVation AEDAT 4.0 file: streams and packets.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "idol/io/block_codec.hpp"
#include "idol/io/random_file.hpp"

namespace idol {

struct AedatStream {
  std::int32_t id = 0;
  std::string kind;  ///< four characters: EVTS, IMUS, FRME, TRIG
  std::string name;  ///< as its camera or module called it; the id if it did not
  int width = 0, height = 0;
};

class AedatFile {
 public:
  /// Throws DataError if this is no AEDAT 4 file, or its header is damaged.
  explicit AedatFile(const std::filesystem::path& path);

  [[nodiscard]] const RandomFile& file() const { return file_; }
  [[nodiscard]] const std::vector<AedatStream>& streams() const { return streams_; }
  /// Written to its end: it has a table of its packets there.
  [[nodiscard]] bool finished() const { return finished_; }

 private:
  friend class AedatPackets;
  void read_streams(const std::string& xml);

  RandomFile file_;
  BlockCodec codec_ = BlockCodec::kNone;
  std::uint64_t begin_ = 0, end_ = 0;  // of the packets
  bool finished_ = false;
  std::vector<AedatStream> streams_;
};

/// The packets of one stream from front to back.
class AedatPackets {
 public:
  AedatPackets(const AedatFile& file, std::int32_t stream) : file_(file), stream_(stream), at_(file.begin_) {}

  /// The next packet's FlatBuffer, valid until the next call; false at the end. Throws DataError on damage.
  bool next(Bytes& buffer);
  /// Passes over the next packet; false at the end.
  bool skip();
  [[nodiscard]] std::uint64_t place() const { return place_; }
  [[nodiscard]] double progress() const;

 private:
  /// Size of the stream's next packet, whose data are then at at_; false at the end.
  bool find(std::uint32_t& size);

  const AedatFile& file_;
  std::int32_t stream_;
  std::uint64_t at_, place_ = 0;
  std::vector<std::uint8_t> packed_, packet_;
};

}  // namespace idol
