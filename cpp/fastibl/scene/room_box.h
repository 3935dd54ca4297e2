// The walls of a room.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

// Walls, floor and ceiling of a room: an upright box around the map's centre (Lagarde and Zanuttini
// 2012, Local Image-based Lighting With Parallax-corrected Cubemaps).
struct RoomBox {
  glm::dvec3 lower{0}, upper{0};  // corners in metres, along the walls' own axes
  double yaw = 0;  // radians, counter-clockwise from above: of these axes about the marker's z axis

  glm::dvec2 axis() const;  // cosine and sine of the yaw
  bool operator==(const RoomBox&) const = default;
};

// A vector of the marker frame, along the axes of walls. axis: cosine and sine of their yaw.
inline glm::dvec3 along_walls(const glm::dvec3& v, const glm::dvec2& axis) {
  return {axis.x * v.x + axis.y * v.y, axis.x * v.y - axis.y * v.x, v.z};
}

// Throws std::invalid_argument for a box that is not finite or does not contain the centre.
void check_box(const RoomBox& box, const glm::dvec3& centre);

// The box of a room whose marker was turned.
RoomBox turned(const RoomBox& box, const glm::dmat3& new_from_old);

// A box around a place in it, as shaders see it: formulas in shaders/shared/near_light.glsl.
struct WallsAround {
  WallsAround(const RoomBox& box, const glm::dvec3& centre);

  // The direction from the centre to the point that a ray d from a place at `offset` meets.
  glm::vec3 direction(glm::vec3 d, glm::vec3 offset) const;

  glm::vec2 axis;          // RoomBox::axis()
  glm::vec3 lower, upper;  // corners along the walls' axes, from the centre
};

}  // namespace fastibl
