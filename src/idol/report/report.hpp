// One self-contained page about a run, readable offline.
#pragma once

#include <filesystem>
#include <string>

namespace idol {

/// What goes into the page. `source` tells it where its data come from: {"kind": "report"} (within it),
/// "runs" or "live" (from the server that it came from).
struct PageContent {
  std::string source;
  std::string run_json = "null";
  std::string events_base64;
};
std::string page_with(const PageContent& content);

/// Reads what is in a run's folder and writes `run_dir`/report.html: one file without anything from outside.
/// What is missing or damaged is left out, with a plain note on the page. Throws DataError when the folder
/// does not exist or holds nothing of a run, or when the disk refuses.
void write_report(const std::filesystem::path& run_dir);

}  // namespace idol
