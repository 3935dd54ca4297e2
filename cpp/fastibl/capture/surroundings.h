// How far from the map's centre the things that it shows are assumed to be.
#pragma once

#include <span>
#include <vector>

#include "fastibl/scene/light_position.h"
#include "fastibl/scene/map_surface.h"

namespace fastibl {

struct TileOutlines;

// Depth of a part of the map: 1 / metres from the centre, the same in all directions, or that of
// the box.
struct Depth {
  float inverse_distance = 0;  // 0: infinitely far
  bool box = false;
  glm::vec3 light{0};  // offset in metres from the centre to a light that the part shows; 0: none
  bool operator==(const Depth&) const = default;
};

// Surroundings above the horizon; what is below is the plane.
class Surroundings {
 public:
  // surface: where everything but lights is assumed to be.
  Surroundings(const TileOutlines& outlines, const MapSurface& surface);

  // Sets the tiles that show a light to the light's distance, unless it is about where everything
  // is assumed to be anyway; the other tiles get the usual depth. Returns the tiles whose depth
  // changed.
  std::vector<int> place(const TileOutlines& outlines, std::span<const LightPosition> lights);

  const MapSurface& surface() const { return surface_; }
  Depth depth(int tile) const { return depths_[std::size_t(tile)]; }
  bool is_usual(const Depth& depth) const { return depth == usual_; }  // not that of a light
  // Lights that some tiles show, and these tiles: 1 for each of them, padded to whole vectors.
  struct LitTiles {
    glm::vec3 light;  // as in Depth
    std::vector<float> tiles;
  };
  const std::vector<LitTiles>& lit_tiles() const { return lit_; }
  // Lights whose distance some tiles have.
  const std::vector<LightPosition>& lights() const { return lights_; }
  // Difference of a light's inverse distance from the one that would be assumed there, 1 / m.
  double gap(const LightPosition& light) const;
  // Whether anything is nearer than infinity.
  bool are_near() const { return near_; }
  // By tile, the length of the direction of its corner c over the corner's distance; padded to
  // whole vectors.
  const std::vector<float>& corner(int c) const { return corners_[c]; }
  // 1 / distance of the walls along their own axes: of the upper and of the lower walls.
  const glm::vec3* walls() const { return walls_; }

 private:
  void set(const TileOutlines& outlines, int tile, const Depth& depth);
  float weight(const glm::vec3& direction, const Depth& depth) const;
  void find_lit();

  MapSurface surface_;
  Depth usual_;
  glm::vec3 walls_[2] = {glm::vec3(0), glm::vec3(0)};
  std::vector<LightPosition> lights_;
  std::vector<LitTiles> lit_;
  std::vector<Depth> depths_;
  std::vector<float> corners_[4];
  bool near_ = false;
};

}  // namespace fastibl
