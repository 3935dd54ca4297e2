// How wrong the irradiance of a captured map is likely to be.
#pragma once

#include "fastibl/scene/environment.h"

namespace fastibl {

// The median over normals of the relative error of the irradiance: the expected value, and the ends
// of an interval that contains it nine times in ten. These are powers of what was not seen, fitted
// to films of four real places, or, without the plane's light, to those of seven and a room, as
// the interval's width is. See ./dev goals capture --only "predicted error", and --only boost for
// lights that clip.
ErrorInterval expected_error(const MapKnowledge& knowledge);

}  // namespace fastibl
