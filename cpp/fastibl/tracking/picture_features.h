// Places of single pictures to which later ones are aligned: finer than the map's texels, and as
// old as they can be, so that what follows them does not drift.
#pragma once

#include <array>
#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/scene/map_surface.h"
#include "fastibl/scene/tile_cone.h"
#include "fastibl/tracking/light_pyramid.h"
#include "fastibl/tracking/map_features.h"

namespace fastibl {

// A picture of one of a rig's cameras.
struct MapView {
  const LightPyramid* light = nullptr;
  const Camera* camera = nullptr;
  const Lens* lens = nullptr;
  glm::dmat3 camera_from_rig{1.0};
  double exposure = 1;
  // For a rolling shutter: the rig is at rotation · exp([s turn]×), marker frame, when the row at a
  // share s of the height is read. turn_by_w: how `turn` changes with w in rotation · exp([w]×).
  glm::dvec3 turn{0};
  glm::dmat3 turn_by_w{0.0};
  // Of what is seen, and where the camera is, metres, marker frame.
  MapSurface surface = {};
  glm::dvec3 eye{0};

  // The direction, not of unit length, in which the camera sees what the map shows in a direction.
  glm::dvec3 seen(const glm::dvec3& direction) const { return surface.seen_from(eye, direction); }
  glm::dvec3 recorded(const glm::dvec3& ray) const { return surface.recorded(eye, ray); }
};

// Rays through the middles of the blocks, at the levels from which features are taken, unit length;
// null where the lens does not reach.
struct BlockRays {
  static constexpr int kFirst = 1;  // level of LightPyramid: blocks of 4 pixels
  std::array<std::vector<glm::vec3>, MapFeatures::kLevels> rays;
  BlockRays(const Camera& camera, const Lens& lens);
};

class PictureFeatures {
 public:
  static constexpr int kLevels = MapFeatures::kLevels;
  static constexpr int kPerTile[kLevels] = {8, 4, 2};  // of 16 × 16 tiles a face
  static constexpr int kMostMissed = 8;

  PictureFeatures();
  void clear();
  // Takes features of a picture, above the horizon, where there are too few yet. drift: variance of
  // the picture's rotation, rad². dark: see MapFeatures.
  void add(const MapView& view, const BlockRays& rays, const glm::dmat3& rig_from_marker,
           float drift, double dark);
  // Forgets features of a tile that did not agree for kMostMissed pictures in a row.
  void forget_missed();

  struct Tile {
    TileCone cone;
    std::vector<MapFeature> features[kLevels];
  };
  const std::vector<Tile>& tiles() const { return tiles_; }
  // Number of features in the tile around a direction.
  int around(const glm::vec3& direction, int level) const {
    return int(tiles_[index(direction)].features[level].size());
  }

 private:
  std::size_t index(const glm::vec3& direction) const;
  // marker_from_camera: by row of blocks.
  void consider(const MapView& view, const BlockRays& rays,
                const std::vector<glm::mat3>& marker_from_camera, int level, int x0, int y0,
                float drift, float dark);
  TileGrid grid_{16};
  std::vector<Tile> tiles_;
};

}  // namespace fastibl
