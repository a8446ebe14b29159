#include "idol/io/aedat_writer.hpp"

#include <fmt/format.h>

#include <numbers>
#include <string>

#include "idol/base/diagnostics.hpp"
#include "idol/io/aedat_recording.hpp"

namespace idol {
namespace {

constexpr std::int32_t kEventStream = 0, kImuStream = 1;
constexpr unsigned kOffset = 4;  // bytes of an offset to a table or vector

std::int64_t microseconds(Time t) { return t >= 0 ? t / 1000 : -((999 - t) / 1000); }

std::int32_t codec_number(BlockCodec codec) {
  switch (codec) {
    case BlockCodec::kNone:
      return 0;
    case BlockCodec::kLz4:
      return 1;
    case BlockCodec::kZstd:
      return 3;
    case BlockCodec::kBzip2:
      break;
  }
  throw UsageError("AEDAT 4 files are compressed with LZ4, Zstandard or not at all");
}

std::string stream_node(std::int32_t id, const char* name, const char* kind, const std::string& info) {
  return fmt::format(R"(<node name="{0}" path="/mainloop/Recorder/outInfo/{0}/">)"
                     R"(<attr key="originalModuleName" type="string">capture</attr>)"
                     R"(<attr key="originalOutputName" type="string">{1}</attr>)"
                     R"(<attr key="typeIdentifier" type="string">{2}</attr>)"
                     R"(<node name="info" path="/mainloop/Recorder/outInfo/{0}/info/">{3}</node></node>)",
                     id, name, kind, info);
}

}  // namespace

AedatWriter::AedatWriter(const std::filesystem::path& path, const WriterOptions& options, BlockCodec codec)
    : file_(path), options_(options), codec_(codec) {
  write_header(-1);
}

/// table IOHeader { compression: int32; dataTablePosition: int64; infoNode: string }.
void AedatWriter::write_header(std::int64_t table_place) {
  std::string size;
  if (options_.width > 0)
    size = fmt::format(R"(<attr key="sizeX" type="int">{}</attr><attr key="sizeY" type="int">{}</attr>)",
                       options_.width, options_.height);
  const std::string source = R"(<attr key="source" type="string">idol</attr>)";
  const std::string xml = R"(<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">)" +
                          stream_node(kEventStream, "events", "EVTS", size + source) +
                          stream_node(kImuStream, "imu", "IMUS", source) + "</node></dv>";
  FlatBuilder header("IOHE");
  const auto places = header.table(FlatBuilder::kRoot, {{0, 4}, {1, 8}, {2, kOffset}});
  header.set(places[0], codec_number(codec_));
  header.set(places[1], table_place);
  const std::size_t text = header.vector(places[2], xml.size() + 1, 1);  // a zero ends it, uncounted
  header.set(text - 4, static_cast<std::uint32_t>(xml.size()));
  for (std::size_t i = 0; i < xml.size(); ++i) header.set(text + i, xml[i]);
  constexpr std::string_view kMagic = "#!AER-DAT4.0\r\n";
  const auto& bytes = header.finish();
  file_.write(kMagic.data(), kMagic.size());
  file_.write(bytes.data(), bytes.size());
}

void AedatWriter::write_packet(std::int32_t stream, FlatBuilder& packet, std::int64_t count, Time first,
                               Time last) {
  const std::vector<std::uint8_t> block = compress(codec_, packet.finish());
  const auto size = static_cast<std::int32_t>(block.size());
  entries_.push_back({file_.place(), stream, size, count, microseconds(first), microseconds(last)});
  file_.write(&stream, 4);
  file_.write(&size, 4);
  file_.write(block.data(), block.size());
}

void AedatWriter::add(const Packet& packet) {
  if (!packet.events.empty()) {
    FlatBuilder flat("EVTS");
    constexpr std::size_t kSize = 16;  // struct Event { timestamp: int64; x, y: int16; on: bool }
    const auto places = flat.table(FlatBuilder::kRoot, {{0, kOffset}});
    std::size_t at = flat.vector(places[0], packet.events.size(), kSize);
    for (const Event& e : packet.events) {
      flat.set(at, microseconds(e.t));
      flat.set(at + 8, e.x);
      flat.set(at + 10, e.y);
      flat.set(at + 12, static_cast<std::uint8_t>(e.polarity ? 1 : 0));
      at += kSize;
    }
    write_packet(kEventStream, flat, std::ssize(packet.events), packet.events.front().t,
                 packet.events.back().t);
  }
  if (packet.imu.empty()) return;
  FlatBuilder flat("IMUS");
  const auto places = flat.table(FlatBuilder::kRoot, {{0, kOffset}});
  const std::size_t list = flat.vector(places[0], packet.imu.size(), kOffset);
  for (std::size_t i = 0; i < packet.imu.size(); ++i) {
    const ImuSample& s = packet.imu[i];
    const auto fields =
        flat.table(list + kOffset * i, {{0, 8}, {2, 4}, {3, 4}, {4, 4}, {5, 4}, {6, 4}, {7, 4}});
    flat.set(fields[0], microseconds(s.t));
    for (int axis = 0; axis < 3; ++axis) {
      const auto j = static_cast<std::size_t>(axis);
      flat.set(fields[1 + j], static_cast<float>(s.accel[axis] / kStandardGravity));
      flat.set(fields[4 + j], static_cast<float>(s.gyro[axis] * 180 / std::numbers::pi));
    }
  }
  write_packet(kImuStream, flat, std::ssize(packet.imu), packet.imu.front().t, packet.imu.back().t);
}

/// table FileDataTable { table: [FileDataDefinition] }, FileDataDefinition { byteOffset: int64;
/// packetInfo: struct { stream, size: int32 }; numElements, timestampStart, timestampEnd: int64 }.
void AedatWriter::write_table() {
  FlatBuilder flat("FTAB");
  const auto places = flat.table(FlatBuilder::kRoot, {{0, kOffset}});
  const std::size_t list = flat.vector(places[0], entries_.size(), kOffset);
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    const Entry& entry = entries_[i];
    const auto fields = flat.table(list + kOffset * i, {{0, 8}, {1, 8}, {2, 8}, {3, 8}, {4, 8}});
    flat.set(fields[0], entry.place);
    flat.set(fields[1], entry.stream);
    flat.set(fields[1] + 4, entry.size);
    flat.set(fields[2], entry.count);
    flat.set(fields[3], entry.first_us);
    flat.set(fields[4], entry.last_us);
  }
  const auto block = compress(codec_, flat.finish());
  file_.write(block.data(), block.size());
}

void AedatWriter::close() {
  const auto table_place = static_cast<std::int64_t>(file_.place());
  write_table();
  file_.seek(0);
  write_header(table_place);
  file_.close();
}

}  // namespace idol
