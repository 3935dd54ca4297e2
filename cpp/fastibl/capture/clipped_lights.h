// Makes lights that clip in the shortest exposure, too, as bright as the plane that they light
// shows them to be.
#pragma once

#include <vector>

#include "fastibl/capture/clipped_texels.h"
#include "fastibl/capture/fill_patch.h"
#include "fastibl/capture/map_tiles.h"
#include "fastibl/core/vector.h"

namespace fastibl {

// What the plane's light says of the lights above it.
struct MissingLight {
  glm::dvec3 irradiance;  // of the plane: how much more was measured than the map gives
  glm::dvec3 deviation;   // standard deviation of that
  double chance;          // that it is missing in what clips, and not in what was never seen
};

// One reading cannot tell lights apart. What faces the plane is made brighter most: the least
// change, as a share of each light, that explains the reading (the mean of independent Gaussians).
// Most of that goes by light, not by texel (kOwnCosine), so that a sky that clips stays even.
// Texels that clip in some channels get only what others cannot take, since their other channels
// say that they are hardly brighter. For a Gaussian error and an excess as large as found, excess²
// / (excess² + deviation²) of it is light.
class ClippedLights {
 public:
  explicit ClippedLights(TileGrid grid) : meetings_(grid) {}

  // most: of the factors; 1 leaves lights what they are. Returns the tiles that show a change.
  std::vector<int> weigh(const MissingLight& missing, double most, MapTiles& map);
  void forget(MapTiles& map);  // for when nothing is known of the plane's light, or of its tiles

  bool any() const { return any_; }  // whether there were lower bounds when they were weighed
  const glm::dvec3& added() const { return added_; }  // to the plane's irradiance
  // Flux, summed over RGB: of what may be boosted, what that adds, and what the plane's light
  // allows to be missing in lower bounds still, one standard deviation.
  double weighed() const { return weighed_; }
  double boosted() const { return boosted_; }
  double doubt() const { return doubt_; }
  // How far apart is what may be boosted: 1 − the length of its mean direction by light; 0 for a
  // sun.
  double spread() const { return spread_; }

 private:
  struct TileBounds {
    int tile;
    BoundLight light;
    double cosine;  // of the light it is part of, to the plane
  };
  // Tiles with lower bounds; those that touch are one light.
  std::vector<TileBounds> bounds_of(const MapTiles& map) const;

  TileMeetings meetings_;
  bool any_ = false;
  glm::dvec3 added_{0};
  double weighed_ = 0, boosted_ = 0, doubt_ = 0, spread_ = 0;
};

}  // namespace fastibl
