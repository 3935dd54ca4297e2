// Places of files whose origin is far away, which float would round too much.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

// What a reader subtracts from places in this box, in double, before it rounds them to float: 0,
// or, where rounding would take more than 1e-4 of the box's size, the box's centre, in whole
// numbers (for a box smaller than 1 with as many decimals as its size has zeros).
glm::dvec3 offset_before_rounding(glm::dvec3 lower, glm::dvec3 upper);

}  // namespace fastibl
