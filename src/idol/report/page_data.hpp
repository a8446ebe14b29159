// The run as the data that the page draws from.
#pragma once

#include <string>

#include "idol/report/run_folder.hpp"

namespace idol {

struct PageData {
  std::string json;    ///< safe inside a page's script element
  std::string events;  ///< pack_events() of each window, one after the other, each filled up to three bytes
};

PageData page_data(const RunFolder& run);

}  // namespace idol
