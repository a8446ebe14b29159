// One self-contained page about a run, readable offline.
#pragma once

#include <filesystem>

namespace idol {

/// Reads what is in a run's folder and writes `run_dir`/report.html: one file without anything from outside.
/// What is missing or damaged is left out, with a plain note on the page. Throws DataError when the folder
/// does not exist or holds nothing of a run, or when the disk refuses.
void write_report(const std::filesystem::path& run_dir);

}  // namespace idol
