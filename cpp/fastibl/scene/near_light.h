// Lights of the map that are so near that, seen a little beside the map's centre, they stand
// elsewhere in the sky and are brighter or darker. Their place is a direction and an inverse
// distance ρ. Where ρ is 0 they are like all other light; see shaders/shared/near_light.glsl.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

struct NearLight {
  glm::vec3 direction{0, 0, 1};  // towards the middle of its light from the map's centre, unit
  float inverse_distance = 0;    // ρ from there, 1 / m
  float sin_radius = 0.01f;      // sine of the angular radius, from there, of a sphere as large
  glm::vec3 irradiance{0};       // on a surface that faces it at the centre
  glm::vec3 around{0};           // radiance of what is around it: what is brighter is its own
};

// Of so many lights `sampled` shows where they are; others are where the map has them.
inline constexpr std::size_t kMostSampledNear = 32;

struct NearLights {
  glm::vec3 centre{0};  // of the map, metres, marker frame
  std::vector<NearLight> lights;

  bool empty() const { return lights.empty(); }
  // The light that this direction (unit length) from the centre meets; null: none.
  const NearLight* towards(glm::vec3 direction) const;
  // 1 / metres from the centre to what is seen in this direction; 0 where there is no near light.
  float inverse_distance(glm::vec3 direction) const {
    const NearLight* light = towards(direction);
    return light ? light->inverse_distance : 0.0f;
  }
  // The position of a light in this direction at this inverse distance; empty if it is distant.
  std::optional<glm::vec3> position(glm::vec3 direction, float inverse_distance) const {
    if (!(inverse_distance > 0)) return std::nullopt;
    return centre + direction / inverse_distance;
  }
};

// The largest change (RGB) that the places of the lights make to the irradiance of any surface
// within `reach` metres of the centre. Seen from x, a light of facing irradiance E gives the vector
// E a/|a|³ with a = d − ρ x; its derivative along x is at most 2ρE/|a|³, so the change is at most
// E (1/(1 − ρ|x|)² − 1). Infinite where a light is within reach.
glm::vec3 most_change(const NearLights& near_lights, float reach);

}  // namespace fastibl
