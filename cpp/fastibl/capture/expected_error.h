// How wrong the irradiance of a captured map is likely to be.
#pragma once

#include "fastibl/scene/environment.h"

namespace fastibl {

// The median over normals of the relative error of the irradiance: what is expected, and the ends
// of an interval that holds it nine times in ten. Fitted to maps captured of real places; see
// ./dev goals capture --only predicted.
ErrorInterval expected_error(const MapKnowledge& knowledge);

}  // namespace fastibl
