// The parts that the compiled module is put together from.
#pragma once

#include <pybind11/pybind11.h>

#include "idol/base/diagnostics.hpp"
#include "idol/base/types.hpp"

namespace idol::python {

void bind_rig(pybind11::module_& module);
void bind_odometry(pybind11::module_& module);
void bind_recordings(pybind11::module_& module);
void bind_jobs(pybind11::module_& module);

/// {kind: (first message, count)}
pybind11::dict to_dict(const Diagnostics& diagnostics);
/// Arrays by the names of Python's States and Lines.
pybind11::dict to_dict(const std::vector<NavState>& states);
pybind11::dict to_dict(const std::vector<Line>& lines);

}  // namespace idol::python
