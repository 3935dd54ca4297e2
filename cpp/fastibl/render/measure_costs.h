// Measures the cost table of this machine: runs each pass's code for a moment on a scene of its
// own.
#pragma once

#include "fastibl/plan/costs.h"

namespace fastibl {

// CPU time of one core; takes some three seconds. What needs cameras' pictures gets its built-in
// cost, scaled by what the rest takes relative to its own built-in costs. All loops run in the
// calling thread alone.
Costs measure_costs();

}  // namespace fastibl
