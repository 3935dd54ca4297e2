// Where a light is in the room.
#pragma once

#include "fastibl/core/vector.h"

namespace fastibl {

// Of a light near enough to be triangulated from several places.
struct LightPosition {
  glm::dvec3 direction{0, 0, 1};  // from the map's centre, unit length
  glm::dvec3 position{0};         // metres, marker frame
  glm::dmat3 covariance{0.0};     // m²
  double radius = 0;              // metres, of a disc that looks as large
};

}  // namespace fastibl
