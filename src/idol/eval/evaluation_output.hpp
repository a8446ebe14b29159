// An evaluation as text for people and as JSON for programs.
#pragma once

#include <string>

#include "idol/eval/protocols.hpp"

namespace idol {

/// A table per kind of error, with notes beneath.
std::string evaluation_text(const Evaluation& evaluation);

/// The schema of docs/evaluation.md. Figures that do not exist (no samples) are null.
std::string evaluation_json(const Evaluation& evaluation);

}  // namespace idol
