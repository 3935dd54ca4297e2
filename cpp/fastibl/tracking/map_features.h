// Places of a captured map to which a picture is aligned: known texels where the map's light
// changes with direction.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/environment.h"
#include "fastibl/scene/tile_cone.h"

namespace fastibl {

struct MapFeature {
  glm::vec3 direction;  // marker frame, unit length: of the texel's middle
  // direction × gradient of green radiance: if the picture turns by w about the map, the light
  // there changes by −w · axis.
  glm::vec3 axis;
  float light;             // green radiance
  float variance;          // relative, of the light
  float width;             // radians, mean of the texel's edges
  float drift;             // variance of its rotation against the marker, rad²
  mutable int missed = 0;  // pictures in a row that did not agree
};

// The tangential gradient of light with direction, from the steps of light along two tangents u and
// v.
glm::vec3 tangent_gradient(const glm::vec3& u, const glm::vec3& v, float lu, float lv);

// Features of all tiles above the horizon, where things are far away; made anew where the map
// changes. Below the horizon lies the plane, whose directions change with the camera's place.
class MapFeatures {
 public:
  static constexpr int kLevels = 3;    // MIP levels of the map: 0 is the finest
  static constexpr int kPerTile = 6;   // strongest features of a tile at level 0
  static constexpr int kPerTile1 = 4;  // at level 1; all at level 2

  // drift: variance of the rotation of what the map shows since the last update, rad².
  void update(const Environment& environment, double drift);
  void clear() { versions_.clear(), tiles_.clear(); }

  int size() const { return grid_.size; }
  const TileGrid& grid() const { return grid_; }
  struct Tile {
    TileCone cone;
    std::vector<MapFeature> features[kLevels];
    bool known = false;  // any of its texels
    float drift = 0;     // variance of its rotation when it was first seen
  };
  const std::vector<Tile>& tiles() const { return tiles_; }
  double dark() const { return dark_; }  // radiance below which differences hardly count

 private:
  void start(const Environment& environment);
  void find_known(const Environment& environment, int tile, float drift);
  void find_features(const Environment& environment, int tile);
  void find_level(const Environment& environment, int tile, int level);
  bool known(int level, int face, int x, int y) const;

  TileGrid grid_;
  std::vector<Tile> tiles_;
  std::vector<std::uint64_t> versions_;
  std::vector<float> variance_;  // relative, by texel and face; negative where not known
  double dark_ = 0;
};

}  // namespace fastibl
