// The cost table of this machine: each pass's code run for a moment on a scene of its own.
#pragma once

#include "fastibl/plan/costs.h"

namespace fastibl {

// CPU time of one core; some three seconds. What needs cameras' pictures is the built-in cost times
// what the rest takes by its own built-in cost. Its loops run in the calling thread alone.
Costs measure_costs();

}  // namespace fastibl
