// Where a hand holds the simulated rig.
#pragma once

#include "fastibl/core/pose.h"

namespace fastibl::demo {

// back_from_marker at a time in seconds: around the board again and again, 0.45 to 0.6 m away,
// tilted from its normal by 25 to 61 degrees, in smooth slow sweeps with a small tremor.
Pose hand_pose(double time);

}  // namespace fastibl::demo
