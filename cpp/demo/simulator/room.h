// The simulator's place: a furnished box whose light is computed once and is then known everywhere.
//
// The world frame is the marker frame: the board lies at the origin, on a table whose top is level
// with the floor. Everything is matte, so radiance does not depend on the viewpoint, and one
// picture per surface holds it. Irradiance is gathered from a fixed set of directions on a coarse
// grid of each surface, repeated a few times for the reflections. That of the lamp, which is small,
// is computed in closed form.
#pragma once

#include <array>
#include <vector>

#include "demo/simulator/surface.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl::demo {

// Directions, with x, y and z in arrays of their own.
struct Rays {
  std::vector<float> x, y, z;
  explicit Rays(std::size_t count = 0) : x(count), y(count), z(count) {}
};

class Room {
 public:
  explicit Room(bool lamp);  // whether the wall lamp is on; takes some tenths of a second

  // The radiance that arrives at a place in the room from a direction, which may have any length
  // but 0.
  glm::vec3 radiance(const glm::vec3& place, const glm::vec3& direction) const {
    return sent_by(leave(place, direction.x, direction.y, direction.z), lamp_);
  }
  void radiance(const glm::vec3& place, const Rays& directions, glm::vec3* out) const;
  glm::vec3 table_irradiance(glm::vec2 place) const;  // place: metres, marker frame
  // The map at a place, without the board; each texel is the mean of `samples`² rays.
  CubeMap environment(const glm::vec3& place, int size, int samples = 3) const;

 private:
  // Where a ray leaves the box: on which side, and at how many metres along its edges.
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
