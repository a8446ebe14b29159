#include "fuzz_recording.hpp"
#include "idol/io/bag_recording.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  idol::read_in_every_way<idol::BagRecording>(data, size);
  return 0;
}
