#include "idol/io/aedat_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <string_view>

#include "idol/base/diagnostics.hpp"
#include "idol/io/flat_table.hpp"
#include "idol/io/number.hpp"

namespace idol {
namespace {

constexpr std::string_view kAedatMagic = "#!AER-DAT4.0\r\n";
constexpr std::size_t kAedatLargestHeader = 1 << 24;
constexpr std::size_t kLargestPacket = 1 << 30;

std::string_view between(std::string_view text, std::string_view before, std::string_view after) {
  const auto begin = text.find(before);
  if (begin == std::string_view::npos) return {};
  const auto rest = text.substr(begin + before.size());
  return rest.substr(0, rest.find(after));
}

int pixels(std::string_view text) {
  const auto value = parse_integer(text);
  constexpr std::int64_t kLargest = 1 << 16;
  return value && *value > 0 && *value <= kLargest ? static_cast<int>(*value) : 0;
}

}  // namespace

AedatFile::AedatFile(const std::filesystem::path& path) : file_(path) {
  std::vector<std::uint8_t> bytes;
  file_.read(0, kAedatMagic.size(), bytes);
  if (!std::equal(bytes.begin(), bytes.end(), kAedatMagic.begin()))
    throw DataError(
        fmt::format("{}: an AEDAT file of version 4.0 is expected; convert older ones with "
                    "iniVation's tools",
                    file_.name()));
  file_.read(kAedatMagic.size(), 4, bytes);
  const auto size = load<std::uint32_t>(bytes, 0);
  if (size > kAedatLargestHeader)
    throw file_.damaged(kAedatMagic.size(), "the file's header", "it would be longer than any");
  file_.read(kAedatMagic.size() + 4, size, bytes);
  begin_ = kAedatMagic.size() + 4 + size;
  try {
    const FlatTable header = FlatTable::root(bytes);
    switch (header.get<std::int32_t>(0)) {
      case 0:
        codec_ = BlockCodec::kNone;
        break;
      case 1:
      case 2:
        codec_ = BlockCodec::kLz4;
        break;
      case 3:
      case 4:
        codec_ = BlockCodec::kZstd;
        break;
      default:
        throw DataError(
            fmt::format("{}: compression {} is not read (0: none, 1 and 2: LZ4, 3 and 4: Zstandard); "
                        "write the file again with one of these",
                        file_.name(), header.get<std::int32_t>(0)));
    }
    const auto table = header.get<std::int64_t>(1, -1);
    finished_ =
        table >= static_cast<std::int64_t>(begin_) && table <= static_cast<std::int64_t>(file_.size());
    end_ = finished_ ? static_cast<std::uint64_t>(table) : file_.size();
    const auto text = header.vector(2, 1);
    const Bytes xml = header.buffer().subspan(text.at, text.count);
    read_streams({xml.begin(), xml.end()});
  } catch (const BadBytes& e) {
    throw file_.damaged(kAedatMagic.size() + 4, "the file's header", e.why);
  }
  if (streams_.empty())
    throw DataError(fmt::format("{}: the file's header names no streams", file_.where(kAedatMagic.size())));
}

/// Of the header's XML only what is needed: <node path=".../outInfo/ID/"> and <attr key="KEY"
/// ...>VALUE</attr>.
void AedatFile::read_streams(const std::string& xml) {
  std::map<std::int32_t, AedatStream> streams;
  std::map<std::int32_t, std::string> sources;
  AedatStream* stream = nullptr;
  for (auto at = xml.find('<'); at != std::string::npos; at = xml.find('<', at + 1)) {
    const std::string_view rest = std::string_view(xml).substr(at);
    const std::string_view tag = rest.substr(0, rest.find('>'));
    if (tag.starts_with("<node ")) {
      const auto id = parse_integer(between(tag, "/outInfo/", "/"));
      stream = nullptr;
      if (!id || *id < 0 || *id > 0x7fffffff) continue;
      stream = &streams[static_cast<std::int32_t>(*id)];
      stream->id = static_cast<std::int32_t>(*id);
    } else if (tag.starts_with("<attr ") && stream != nullptr) {
      const auto key = between(tag, "key=\"", "\"");
      const auto value = between(rest, ">", "<");
      if (key == "typeIdentifier") stream->kind = value;
      if (key == "originalOutputName") stream->name = value;
      if (key == "source") sources[stream->id] = value;
      if (key == "sizeX") stream->width = pixels(value);
      if (key == "sizeY") stream->height = pixels(value);
    }
  }
  // Of several cameras, each has an "events": the source tells them apart.
  for (auto& [id, s] : streams) {
    if (s.kind.empty()) continue;
    if (s.name.empty()) s.name = fmt::format("{}", id);
    const auto same = [&named = s](const AedatStream& other) {
      return other.name == named.name && other.kind == named.kind;
    };
    if (std::count_if(streams.begin(), streams.end(), [&](const auto& o) { return same(o.second); }) > 1 &&
        !sources[id].empty()) {
      streams_.push_back(s);
      streams_.back().name = fmt::format("{}/{}", sources[id], s.name);
    } else {
      streams_.push_back(s);
    }
  }
}

bool AedatPackets::find(std::uint32_t& size) {
  const RandomFile& file = file_.file_;
  while (at_ < file_.end_) {
    place_ = at_;
    file.read(at_, 8, packed_);
    const auto id = load<std::int32_t>(packed_, 0);
    size = load<std::uint32_t>(packed_, 4);
    if (size > kLargestPacket) throw file.damaged(place_, "a packet", "it would be longer than any");
    at_ += 8;
    if (id == stream_) return true;
    at_ += size;
    if (at_ > file.size()) file.read(at_ - size, size, packed_);  // says that it is cut off
  }
  return false;
}

bool AedatPackets::next(Bytes& buffer) {
  std::uint32_t size = 0;
  if (!find(size)) return false;
  file_.file_.read(at_, size, packed_);
  at_ += size;
  try {
    decompress(file_.codec_, packed_, kLargestPacket, packet_);
    buffer = ByteCursor(Bytes(packet_).subspan(std::min<std::size_t>(4, packet_.size())))
                 .take(load<std::uint32_t>(packet_, 0));
  } catch (const BadBytes& e) {
    throw file_.file_.damaged(place_, "a packet", e.why);
  }
  return true;
}

bool AedatPackets::skip() {
  std::uint32_t size = 0;
  if (!find(size)) return false;
  at_ += size;
  return true;
}

double AedatPackets::progress() const {
  return std::min(1.0, static_cast<double>(at_) / static_cast<double>(file_.end_));
}

}  // namespace idol
