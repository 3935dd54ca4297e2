// What the map knows of the places that a picture shows.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/light_changes.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/picture_level.h"
#include "fastibl/capture/place_layout.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/camera.h"

namespace fastibl {

// Rays (camera frame) through the middles of the picture's parts that are compared with the map;
// std::nullopt beyond the lens model.
std::vector<std::optional<glm::dvec3>> probe_rays(const Camera& camera, const Lens& lens);

// Appends those that the map knows, unsure: or of which it has any idea.
void probe_level(const PosedPicture& posed, const PlaceLayout& place, const MapTiles& map,
                 const LightChanges& changes, bool unsure, std::vector<LevelProbe>& probes);

}  // namespace fastibl
