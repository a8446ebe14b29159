#include "fuzz_recording.hpp"
#include "idol/io/hdf5_recording.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  idol::read_in_every_way<idol::Hdf5Recording>(data, size);
  return 0;
}
