// The maps that are handed out.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/capture/map_tiles.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/environment.h"

namespace fastibl {

class MapSnapshots {
 public:
  // An environment with the texels of the map as they are now; what is known of them as a whole is
  // still to be set. An earlier one that nobody holds any more is reused: only tiles that changed
  // since then are written.
  std::shared_ptr<Environment> take(const MapTiles& map);

 private:
  std::shared_ptr<Environment> free_snapshot(const MapTiles& map);

  std::vector<std::shared_ptr<Environment>> snapshots_;  // handed out before, the latest first
};

}  // namespace fastibl
