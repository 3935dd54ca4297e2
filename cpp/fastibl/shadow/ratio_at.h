// The share of the light that reaches points of the plane, without a grid.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/light_directions.h"

namespace fastibl {

// Ratio of the light with and without the spheres at points of the plane z = 0, RGB in [0, 1]; 1 at
// a point that is not finite. Tries every sphere for every direction and point, in double.
std::vector<glm::vec3> ratio_at(std::span<const glm::vec2> points, const SphereSet& spheres,
                                std::span<const LightDirection> light);

}  // namespace fastibl
