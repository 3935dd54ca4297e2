// How much each point of a surface contributes to the outlines that shadows have.
#pragma once

#include "fastibl/shadow/voxel_surface.h"

namespace fastibl {

// The share of the outlines, seen from 48 directions all around, that each point makes; plus a
// little for every point, more where the body is thin, so that no holes open. The mean is 1.
// points: not empty.
// A point that is never on an outline can be wrong without a trace in any shadow. The rule also
// gives thin and strongly curved parts the weight that their small volume denies them.
std::vector<float> outline_weights(const std::vector<SurfacePoint>& points);

}  // namespace fastibl
