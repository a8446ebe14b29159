// Curves of the state: what the estimator says of itself, with its 3-sigma bands, beside ground truth.
#pragma once

#include <vector>

#include "idol/report/curves.hpp"

namespace idol {

/// Position, orientation, velocity and biases of the IMU, smoothed and causal, the latter with bands; ground
/// truth where there is one.
std::vector<Panel> state_panels(const RunFolder& run, const AlignedTruth& truth, Time zero);

/// Errors of the causal position, orientation and velocity by axis, each with its band around zero. The world
/// is laid over that of the ground truth at the first pose, as the standard deviations are relative to it.
std::vector<Panel> causal_error_panels(const RunFolder& run, Time zero);

}  // namespace idol
