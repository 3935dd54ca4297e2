// Where a light is in the room.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/vector.h"

namespace fastibl {

// Angular radius (radians) of a disc of this solid angle (steradians).
inline double disc_radius(double solid_angle) {
  return std::acos(std::max(-1.0, 1 - solid_angle / (2 * std::numbers::pi)));
}

// A light near enough to be triangulated from several places.
struct LightPosition {
  glm::dvec3 direction{0, 0, 1};  // from the map's centre, unit length
  glm::dvec3 position{0};         // metres, marker frame
  glm::dmat3 covariance{0.0};     // m²
  double radius = 0;              // metres, of a disc that looks as large
  bool operator==(const LightPosition&) const = default;
};

// Angular radius (radians) of the light as seen from a place.
inline double angular_radius(const LightPosition& light, const glm::dvec3& from) {
  return std::asin(std::min(light.radius / glm::length(light.position - from), 1.0));
}

}  // namespace fastibl
