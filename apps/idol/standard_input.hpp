// Standard input as a file: recordings are read more than once.
#pragma once

#include <filesystem>

namespace idol::cli {

/// The path itself or, for `-`, that of a temporary file with all of standard input, which lasts as long as
/// the program. Throws UsageError if standard input is a terminal or was asked for twice, DataError if it
/// cannot be kept. Ctrl-C ends the wait for it, and the program.
std::filesystem::path input_path(const std::filesystem::path& path);

}  // namespace idol::cli
