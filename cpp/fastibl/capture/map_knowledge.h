// What is known of a map's light as a whole.
#pragma once

#include "fastibl/capture/map_fills.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/scene/environment.h"

namespace fastibl {

// Shares of the map that were seen or clip, and those of its knowledge that its texels tell: not
// what rests on the board's white, and on how near things are.
struct MapShares {
  double coverage = 0, clipped = 0;  // as an Environment has them
  MapKnowledge knowledge;
};
MapShares shares_of(const MapTiles& map, const MapFills& fills);

}  // namespace fastibl
