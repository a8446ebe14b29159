// The run as the JSON text that the report's page draws from.
#pragma once

#include <string>
#include <string_view>

#include "idol/report/run_folder.hpp"

namespace idol {

/// JSON that is safe inside a page's script element: it holds no '<'.
std::string page_data(const RunFolder& run);

/// RFC 4648, with padding.
std::string base64(std::string_view bytes);

}  // namespace idol
