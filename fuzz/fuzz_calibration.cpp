// Calibrations: Kalibr, OpenVINS, Basalt, iniVation's XML and RPG's calib.txt, told apart by content.
#include "fuzz_recording.hpp"
#include "idol/base/rig.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const idol::MemoryFile file(data, size);
  try {
    static_cast<void>(idol::find_camera({}, file.path()));
  } catch (const idol::DataError&) {
  }
  try {
    static_cast<void>(idol::load_rig({}, file.path(), file.path()));
  } catch (const idol::DataError&) {
  }
  return 0;
}
