// Event and IMU rows, plain or compressed; trajectories.
#include "fuzz_recording.hpp"
#include "idol/io/imu_stream.hpp"
#include "idol/io/text_recording.hpp"
#include "idol/io/trajectory_io.hpp"

namespace {

class EventsFile : public idol::TextRecording {
 public:
  EventsFile(const std::filesystem::path& path, const idol::StreamChoice&) : TextRecording(path) {}
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  idol::read_in_every_way<EventsFile>(data, size);
  const idol::MemoryFile file(data, size);
  for (const auto& layout : {idol::rpg_imu_layout(), idol::asl_imu_layout(), idol::tum_vie_imu_layout()}) {
    try {
      idol::Diagnostics diagnostics;
      idol::ImuStream rows(idol::open_imu_text(file.path(), layout), {}, diagnostics);
      for (idol::ImuSample sample; rows.next(sample);) {
      }
    } catch (const idol::DataError&) {
    }
  }
  try {
    static_cast<void>(idol::read_trajectory(file.path()));
  } catch (const idol::DataError&) {
  }
  return 0;
}
