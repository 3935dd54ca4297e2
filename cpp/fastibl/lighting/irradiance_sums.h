// Irradiance summed over a folded map.
#pragma once

#include "fastibl/lighting/octant_grid.h"

namespace fastibl {

// The irradiance at the centres of a cube map's texels, border included. The weights of the texels
// are divided by their sum, so that a constant map gives π everywhere; never negative.
CubeLevel irradiance_cube(const FoldedMap& map, int size);

// The part of the irradiance that is even under n → −n, ½ ∫ L |n·w| dw, at the nodes of an octant
// and at their mirror images in x, y and z.
std::vector<std::array<glm::vec3, 4>> even_irradiance(const FoldedMap& map,
                                                      const OctantGrid& nodes);

}  // namespace fastibl
