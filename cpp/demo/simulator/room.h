// The simulator's place: a furnished box whose light is worked out once and then known everywhere.
//
// World = marker frame: the board lies at the origin on a table whose top is level with the floor.
// All is matte, so radiance does not depend on where it is seen from and one picture a surface
// holds it. Irradiance is gathered with a fixed set of directions on a coarse grid of each surface,
// a few times over for the reflections; the lamp's, which is small, in closed form.
#pragma once

#include <array>
#include <vector>

#include "demo/simulator/surface.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl::demo {

// Directions, x, y and z apart.
struct Rays {
  std::vector<float> x, y, z;
  explicit Rays(std::size_t count = 0) : x(count), y(count), z(count) {}
};

class Room {
 public:
  explicit Room(bool lamp);  // whether the lamp on the wall is on; takes some tenths of a second

  // That arrives at a place in the room, from a direction of any length but 0.
  glm::vec3 radiance(const glm::vec3& place, const glm::vec3& direction) const {
    return sent_by(leave(place, direction.x, direction.y, direction.z), lamp_);
  }
  void radiance(const glm::vec3& place, const Rays& directions, glm::vec3* out) const;
  glm::vec3 table_irradiance(glm::vec2 place) const;  // metres, marker frame
  // The map there: each texel the mean of `samples`² rays. Without the board.
  CubeMap environment(const glm::vec3& place, int size, int samples = 3) const;

 private:
  // Where a ray leaves the box: on a side, at metres along its edges.
  struct Hit {
    int side;
    float a, b;
  };
  static Hit leave(const glm::vec3& place, float x, float y, float z);
  glm::vec3 sent_by(const Hit& hit, bool lamp) const;
  glm::vec3 gather(const glm::vec3& place, const glm::vec3& normal) const;
  glm::vec3 from_lamp(const glm::vec3& place, const glm::vec3& normal) const;
  void light();

  bool lamp_;
  std::array<Surface, 6> sides_;  // −x +x −y +y −z +z
  Surface table_;
};

}  // namespace fastibl::demo
