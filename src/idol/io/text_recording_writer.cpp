#include "idol/io/text_recording_writer.hpp"

#include <fmt/format.h>

#include <iterator>

#include "idol/io/output_guard.hpp"
#include "idol/io/sequence_files.hpp"
#include "idol/io/trajectory_io.hpp"

namespace idol {

namespace fs = std::filesystem;

TextRecordingWriter::TextRecordingWriter(const fs::path& folder, bool compress)
    : folder_(folder), compress_(compress) {
  claim_folder(folder, FolderContent::kRecording);
}

void TextRecordingWriter::add(std::span<const Event> events) {
  if (!events_) events_.emplace(folder_ / (compress_ ? "events.txt.zst" : "events.txt"));
  fmt::memory_buffer text;
  for (const Event& e : events)
    fmt::format_to(std::back_inserter(text), "{} {} {} {:d}\n", format_stamp(e.t), e.x, e.y, e.polarity);
  events_->write({text.data(), text.size()});
}

// As many digits as it takes to read the same number back.
void TextRecordingWriter::add(const ImuSample& s) {
  if (!imu_) imu_.emplace(folder_ / "imu.txt");
  imu_->write(fmt::format("{} {} {} {} {} {} {}\n", format_stamp(s.t), s.accel.x(), s.accel.y(), s.accel.z(),
                          s.gyro.x(), s.gyro.y(), s.gyro.z()));
}

void TextRecordingWriter::add(const Packet& packet) {
  if (!packet.events.empty()) add(packet.events);
  for (const ImuSample& sample : packet.imu) add(sample);
}

bool TextRecordingWriter::add_groundtruth(const Trajectory& truth) {
  truth_ = truth;
  return true;
}

void TextRecordingWriter::close() {
  std::error_code error;
  for (const char* name : {"events.txt", "imu.txt", "groundtruth.txt"})
    for (const fs::path& old : find_stream_files(folder_, name)) fs::remove(old, error);
  if (!truth_.empty()) write_trajectory(folder_ / "groundtruth.txt", truth_);
  for (auto* file : {&events_, &imu_})
    if (*file) (*file)->close();
}

}  // namespace idol
