// Moves what a map holds above the horizon to where it belongs: after the marker was turned under
// it, and once the distance of things is known.
#pragma once

#include <vector>

#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/place_layout.h"
#include "fastibl/capture/surroundings.h"
#include "fastibl/capture/tile_views.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// What is above the horizon turns; the rest is forgotten.
void turn_map(const glm::dmat3& new_from_old, MapTiles& map);

// What was recorded for other surroundings was seen from a known place, so it can be recorded anew.
// Returns, by tile, the one that showed before what it shows now.
std::vector<int> move_map(const Surroundings& before, const PlaceLayout& place,
                          const TileViews& views, MapTiles& map);

}  // namespace fastibl
