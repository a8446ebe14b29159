// The time between the clocks of two trajectories of one motion.
#pragma once

#include "idol/base/types.hpp"

namespace idol {

/// t_truth = t_estimate + offset, from how fast both turn (without orientations: move) over time; any offset
/// at which they overlap by half of the shorter one. Throws DataError where the motions do not resemble each
/// other.
Time find_time_offset(const Trajectory& estimate, const Trajectory& truth);

/// The trajectory by a clock that is later by this.
Trajectory shifted(Trajectory trajectory, Time offset);

}  // namespace idol
