// One self-contained page about a run, readable offline.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace idol {

/// The page with data in it. `source` tells it where these come from: {"kind": "report"} (from within),
/// "runs" or "live" (from the server that it came from). `run_json` must hold no '<'.
std::string page_with(std::string_view source, std::string_view run_json = "null",
                      std::string_view events_base64 = "");

/// Reads what is in a run's folder and writes `run_dir`/report.html: one file without anything from outside.
/// What is missing or damaged is left out, with a plain note on the page. Throws DataError when the folder
/// does not exist or holds nothing of a run, or when the disk refuses.
void write_report(const std::filesystem::path& run_dir);

}  // namespace idol
