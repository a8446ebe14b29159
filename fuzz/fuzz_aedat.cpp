#include "fuzz_recording.hpp"
#include "idol/io/aedat_recording.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  idol::read_in_every_way<idol::AedatRecording>(data, size);
  return 0;
}
