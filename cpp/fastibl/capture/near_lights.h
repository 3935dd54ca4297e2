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

// Where lights were recorded while their places were unknown or wrong, the map shows them beside
// themselves: there, texels brighter than `bright` (radiance) become unseen. What the last picture
// told of a light goes with it to where it is, for the next one may clip there, and the light would
// go out until one does not. Only lights that the last picture shows are moved. moved: tiles that
// show one only now. Returns the tiles that changed.
std::vector<int> move_lights(std::span<const LightPosition> lights, const std::vector<int>& moved,
                             const PlaceLayout& place, double bright, MapTiles& map);

}  // namespace fastibl
