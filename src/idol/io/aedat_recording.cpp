#include "idol/io/aedat_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "idol/io/choose_stream.hpp"
#include "idol/io/flat_table.hpp"

namespace idol {
namespace {

/// Checks that a packet is of the kind its stream says.
FlatTable open_packet(Bytes buffer, std::string_view kind) {
  const Bytes written = ByteCursor(buffer.subspan(std::min<std::size_t>(4, buffer.size()))).take(4);
  if (!std::equal(written.begin(), written.end(), kind.begin(), kind.end()))
    throw BadBytes{"it is of another type than its stream"};
  return FlatTable::root(buffer);
}

/// The packets of one stream, decoded.
template <class Row>
class AedatSource : public RowSource<Row> {
 public:
  AedatSource(std::shared_ptr<const AedatFile> file, const AedatStream& stream)
      : file_(std::move(file)),
        packets_(*file_, stream.id),
        name_(fmt::format("{}: {}", file_->file().name(), stream.name)) {}

  std::span<const Row> read() override {
    rows_.clear();
    Bytes buffer;
    while (rows_.empty() && packets_.next(buffer)) {
      try {
        decode(buffer, rows_);
      } catch (const BadBytes& e) {
        throw DataError(fmt::format("{}: the packet is damaged: {}", where(0), e.why));
      }
    }
    return rows_;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string where(std::size_t i) const override {
    return fmt::format("{}, byte {}{}", name_, packets_.place(), i > 0 ? fmt::format(", row {}", i) : "");
  }
  [[nodiscard]] double progress() const override { return packets_.progress(); }

 private:
  static void decode(Bytes buffer, std::vector<Row>& rows);

  std::shared_ptr<const AedatFile> file_;
  AedatPackets packets_;
  std::string name_;
  std::vector<Row> rows_;
};

/// struct Event { int64 timestamp; int16 x, y; bool on; }, 16 bytes.
template <>
void AedatSource<Event>::decode(Bytes buffer, std::vector<Event>& rows) {
  constexpr std::size_t kSize = 16;
  const FlatTable packet = open_packet(buffer, "EVTS");
  const auto list = packet.vector(0, kSize);
  rows.resize(list.count);
  const std::uint8_t* p = buffer.data() + list.at;
  for (Event& e : rows) {
    std::int64_t us = 0;
    std::memcpy(&us, p, 8);
    std::memcpy(&e.x, p + 8, 2);
    std::memcpy(&e.y, p + 10, 2);
    e.t = from_us(us);
    e.polarity = p[12] != 0;
    p += kSize;
  }
}

/// table IMU { timestamp; temperature; accelerometer X Y Z; gyroscope X Y Z; magnetometer X Y Z }.
template <>
void AedatSource<ImuSample>::decode(Bytes buffer, std::vector<ImuSample>& rows) {
  constexpr double kDegree = std::numbers::pi / 180;
  const FlatTable packet = open_packet(buffer, "IMUS");
  const auto list = packet.vector(0, 4);
  for (std::size_t i = 0; i < list.count; ++i) {
    const FlatTable imu = packet.element(list, i);
    const auto vec3 = [&](unsigned first) {
      return Vec3(imu.get<float>(first), imu.get<float>(first + 1), imu.get<float>(first + 2));
    };
    rows.push_back({from_us(imu.get<std::int64_t>(0)), vec3(2) * kStandardGravity, vec3(5) * kDegree});
  }
}

/// table Frame { timestamp; four stamps of readout and exposure; format; sizeX; sizeY; positionX; positionY;
/// pixels }.
class AedatFrames : public FrameSource {
 public:
  AedatFrames(std::shared_ptr<const AedatFile> file, const AedatStream& stream)
      : file_(std::move(file)), packets_(*file_, stream.id) {}

  bool next(Frame& frame) override {
    Bytes buffer;
    if (!packets_.next(buffer)) return false;
    try {
      const FlatTable picture = open_packet(buffer, "FRME");
      frame.t = from_us(picture.get<std::int64_t>(0));
      const auto format = picture.get<std::int8_t>(5);  // OpenCV's: 0 + 8 (channels - 1) for 8 bits
      const auto width = picture.get<std::uint16_t>(6), height = picture.get<std::uint16_t>(7);
      const auto pixels = picture.vector(10, 1);
      if (format < 0 || format % 8 != 0 || format > 24)
        throw UnknownFormat(fmt::format("pictures of OpenCV's type {} are not read; 8 bits are", format));
      const auto channels = static_cast<std::size_t>(format / 8 + 1);
      fill_grey(frame, buffer.subspan(pixels.at, pixels.count), width, height, width * channels, channels);
    } catch (const BadBytes& e) {
      throw DataError(
          fmt::format("{}: the packet is damaged: {}", file_->file().where(packets_.place()), e.why));
    } catch (const UnknownFormat& e) {
      throw DataError(fmt::format("{}: {}", file_->file().where(packets_.place()), e.what()));
    }
    return true;
  }

 private:
  std::shared_ptr<const AedatFile> file_;
  AedatPackets packets_;
};

std::int64_t count_elements(const AedatFile& file, const AedatStream& stream) {
  std::int64_t count = 0;
  AedatPackets packets(file, stream.id);
  if (stream.kind == "FRME") {  // a packet each; no need to unpack the picture
    while (packets.skip()) ++count;
    return count;
  }
  for (Bytes buffer; packets.next(buffer);)
    count += static_cast<std::int64_t>(
        open_packet(buffer, stream.kind).vector(0, stream.kind == "EVTS" ? 16 : 4).count);
  return count;
}

const char* describe(const std::string& kind) {
  if (kind == "EVTS") return "events";
  if (kind == "IMUS") return "IMU";
  if (kind == "FRME") return "frames";
  if (kind == "TRIG") return "triggers";
  return "not known";
}

}  // namespace

AedatRecording::AedatRecording(const std::filesystem::path& path, StreamChoice choice)
    : file_(std::make_shared<AedatFile>(path)), choice_(std::move(choice)) {}

/// A stream may be announced in the header and never come.
bool AedatRecording::has(const char* kind) const {
  const auto holds_packets = [&](const AedatStream& stream) {
    try {
      return AedatPackets(*file_, stream.id).skip();
    } catch (const DataError&) {
      return true;  // whoever reads it will hear of the damage
    }
  };
  const auto& streams = file_->streams();
  return std::any_of(streams.begin(), streams.end(),
                     [&](const AedatStream& s) { return s.kind == kind && holds_packets(s); });
}

const AedatStream* AedatRecording::choose(const char* kind, const std::string& name, const char* plural,
                                          const char* option) const {
  std::vector<const AedatStream*> streams;
  std::vector<std::string> names;
  for (const AedatStream& stream : file_->streams()) {
    if (stream.kind != kind) continue;
    streams.push_back(&stream);
    names.push_back(stream.name);
  }
  const auto chosen = choose_stream(file_->file().name(), plural, option, names, name);
  return chosen ? streams[*chosen] : nullptr;
}

std::unique_ptr<RowSource<Event>> AedatRecording::events(Diagnostics& diagnostics) {
  const AedatStream* stream = choose("EVTS", choice_.events, "streams of events", "--events-topic");
  if (stream == nullptr) throw DataError(fmt::format("{}: holds no stream of events", file_->file().name()));
  warn_if_unfinished(diagnostics);
  return std::make_unique<AedatSource<Event>>(file_, *stream);
}

std::unique_ptr<RowSource<ImuSample>> AedatRecording::imu(Diagnostics& diagnostics) {
  const AedatStream* stream = choose("IMUS", choice_.imu, "streams of IMU data", "--imu-topic");
  if (stream == nullptr)
    throw DataError(fmt::format("{}: holds no IMU data; was the IMU switched on?", file_->file().name()));
  warn_if_unfinished(diagnostics);
  return std::make_unique<AedatSource<ImuSample>>(file_, *stream);
}

std::unique_ptr<FrameSource> AedatRecording::frames() {
  for (const AedatStream& stream : file_->streams())
    if (stream.kind == "FRME") return std::make_unique<AedatFrames>(file_, stream);
  return nullptr;
}

std::vector<StreamInfo> AedatRecording::streams() {
  std::vector<StreamInfo> found;
  for (const AedatStream& stream : file_->streams()) {
    StreamInfo info{stream.name, describe(stream.kind), -1};
    try {
      info.count = count_elements(*file_, stream);
    } catch (const DataError&) {
    } catch (const BadBytes&) {
      // Not known, then: damage is told of when the stream is read.
    }
    found.push_back(info);
  }
  return found;
}

Recording::Resolution AedatRecording::resolution() {
  const AedatStream* stream = choose("EVTS", choice_.events, "streams of events", "--events-topic");
  if (stream == nullptr) return {};
  return {stream->width, stream->height};
}

void AedatRecording::warn_if_unfinished(Diagnostics& diagnostics) const {
  if (!file_->finished() && !diagnostics.entries().contains("unfinished_file"))
    diagnostics.warn("unfinished_file",
                     fmt::format("{}: has no table of its packets at its end: the recording was not stopped "
                                 "properly, or the file is cut off",
                                 file_->file().name()));
}

}  // namespace idol
