// The main lights of a place, as a person would count them: windows, lamps, the sun.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/core/vector.h"
#include "fastibl/scene/environment.h"

namespace fastibl {

struct MainLight {
  glm::vec3 direction{0, 0, 1};        // towards the middle of its light, unit length
  float solid_angle = 0;               // steradians
  float angular_radius = 0;            // radians, of a disc as large
  glm::vec3 irradiance{0};             // on a plane that faces it, from this light alone
  float share = 0;                     // of the irradiance of that plane, mean over RGB
  std::optional<LightPosition> place;  // if it was triangulated
};

struct MainLightOptions {
  double brightness = 8;     // lights exceed this many times the map's mean radiance (RGB mean)
  double least_share = 0.1;  // of the irradiance on a plane that faces the light
};

// Finds connected regions of bright texels; the one with the largest irradiance comes first. Their
// light stays in the map: for shading, use Lighting's own lights. Throws std::invalid_argument for
// options that are not positive and finite.
std::vector<MainLight> main_lights(const CubeMap& map, const MainLightOptions& options = {});

// The same, with the places that the capture found.
std::vector<MainLight> main_lights(const Environment& environment,
                                   const MainLightOptions& options = {});

}  // namespace fastibl
