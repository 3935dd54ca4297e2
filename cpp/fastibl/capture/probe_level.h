// What the map knows of the places that a picture shows.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

// Rays (camera frame) through the middles of the picture's parts that are compared with the map;
// std::nullopt beyond the lens model.
std::vector<std::optional<glm::dvec3>> probe_rays(const Camera& camera, const Lens& lens);

}  // namespace fastibl
