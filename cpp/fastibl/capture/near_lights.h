// Near lights: what they hide, and what the map knew of them while their place was not known.
#pragma once

#include <span>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/capture/place_layout.h"
#include "fastibl/scene/light_position.h"

namespace fastibl {

// A part of a picture.
struct Disc {
  float x, y, squared_radius;  // pixels
};
// Those that show lights. A near light hides what is far behind it, which other tiles than its own
// show.
std::vector<Disc> discs_of(std::span<const LightPosition> lights, const PosedPicture& posed);

// Where the light was recorded while its place was unknown or wrong, the map shows it beside
// itself, and that part must be seen anew: texels brighter than `bright` (radiance) become unseen.
// Only a light that the last picture shows is forgotten, as it is seen anew at once. moved: tiles
// that show it only now. Returns the tiles that changed.
std::vector<int> forget_light(const LightPosition& light, const std::vector<int>& moved,
                              const PlaceLayout& place, double bright, MapTiles& map);

}  // namespace fastibl
