// What of a map's light comes from lights whose place is known.
#pragma once

#include "fastibl/scene/environment.h"
#include "fastibl/scene/near_light.h"

namespace fastibl {

// A light's own light is what is brighter, within its outline, than what is around it. Its ρ is
// that of its position, d metres from the centre with standard deviation σ along the line of sight,
// times 1 − (5 σ/d)²: a light that is just about triangulated is distant, and nears as it is known
// better, so that nothing jumps; at σ = d/50 it lacks a hundredth. Positions that are not
// finite, at the centre, or of a light around it, are distant: they are left out, as are those
// where the map is not bright.
NearLights find_near_lights(const Environment& environment);

}  // namespace fastibl
