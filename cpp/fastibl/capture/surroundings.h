// How far from the map's centre what it shows is thought to be.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fastibl/scene/light_position.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

struct TileOutlines;

// Depth of a part of the map: 1 / metres from the centre, the same in all directions; or the box's.
struct Depth {
  float inverse_distance = 0;  // 0: infinitely far
  bool box = false;
  glm::vec3 light{0};  // metres from the centre, of a light that the part shows; 0: of none
  bool operator==(const Depth&) const = default;
};

// Above the horizon; what is below is the plane.
class Surroundings {
 public:
  // distance: metres, may be infinite; a box, where there is one, goes before it.
  Surroundings(const TileOutlines& outlines, const glm::dvec3& centre, double distance,
               const std::optional<RoomBox>& box);

  // Takes the tiles that show a light to be as far as it is, unless that is as far as they were
  // thought to be anyway; the others as before. Returns the tiles whose depth changed.
  std::vector<int> place(const TileOutlines& outlines, std::span<const LightPosition> lights);

  // Direction of the map in which a line of sight is recorded where no light is placed: that from
  // the centre to where it meets the box, the sphere of that distance, or infinity.
  glm::dvec3 recorded(const glm::dvec3& eye, const glm::dvec3& direction) const;

  Depth depth(int tile) const { return depths_[std::size_t(tile)]; }
  bool is_usual(const Depth& depth) const { return depth == usual_; }  // no light's
  // Lights that some tiles show, and which: 1 of those, as long as fills vectors.
  struct LitTiles {
    glm::vec3 light;  // as in Depth
    std::vector<float> tiles;
  };
  const std::vector<LitTiles>& lit_tiles() const { return lit_; }
  // Lights that some tiles are as far as.
  const std::vector<LightPosition>& lights() const { return lights_; }
  // How near all is thought to be but for these, 1 / m, in a direction.
  double usual(const glm::dvec3& direction) const;
  bool has_box() const { return usual_.box; }
  // Difference of a light's inverse distance to what it would be thought to be, 1 / m.
  double gap(const LightPosition& light) const;
  // Whether anything is nearer than infinity.
  bool are_near() const { return near_; }
  // Length of the direction of a tile's corner over its distance, as long as fills vectors.
  const std::vector<float>& corner(int c) const { return corners_[c]; }
  // 1 / distance of the walls along the axes: of the upper and the lower one.
  const glm::vec3* walls() const { return walls_; }

 private:
  void set(const TileOutlines& outlines, int tile, const Depth& depth);
  float weight(const glm::vec3& direction, const Depth& depth) const;
  void find_lit();

  glm::dvec3 centre_;
  Depth usual_;
  glm::vec3 walls_[2] = {glm::vec3(0), glm::vec3(0)};
  std::vector<LightPosition> lights_;
  std::vector<LitTiles> lit_;
  std::vector<Depth> depths_;
  std::vector<float> corners_[4];
  bool near_ = false;
};

}  // namespace fastibl
