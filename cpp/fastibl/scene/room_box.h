// The walls of a room.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

// Walls, floor and ceiling of a room: an axis-aligned box around the map's centre, metres, marker
// frame (Lagarde and Zanuttini 2012, Local Image-based Lighting With Parallax-corrected Cubemaps).
struct RoomBox {
  glm::dvec3 lower{0}, upper{0};
};

// Throws std::invalid_argument for a box that is not finite or does not contain the centre.
void check_box(const RoomBox& box, const glm::dvec3& centre);

}  // namespace fastibl
