// What in a recording will hurt a run, in words: said by `idol info`, and by `idol run` before it begins.
#pragma once

#include <string>

#include "idol/base/diagnostics.hpp"
#include "idol/base/rig.hpp"
#include "idol/io/reader.hpp"
#include "idol/io/recording_summary.hpp"

namespace idol {

/// As far as they are known.
struct KnownRig {
  const Camera* camera = nullptr;
  const Rig* rig = nullptr;
};

/// `whole`: the summary is of the whole recording or span, not of its beginning.
void judge_recording(const std::string& recording, const RecordingSummary& summary, const KnownRig& known,
                     Time origin, bool whole, Diagnostics& diagnostics);

/// Why a run on this is impossible; empty: it is not.
std::string what_makes_impossible(const std::string& recording, const RecordingSummary& summary,
                                  const KnownRig& known, bool whole);

/// Reads the beginning of what `reading` says and judges it: what a run does before it begins. Throws
/// DataError if it is impossible. Damage is left to the run, which will come to it.
Diagnostics check_recording(const std::filesystem::path& sequence, ReaderOptions reading, const Rig& rig);

}  // namespace idol
