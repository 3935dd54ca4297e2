// The light of near lights on the marker plane, relative to the light that they send to the map's
// centre.
//
// A direction d of the map that belongs to a light of inverse distance ρ is a point at d/ρ from the
// centre c: in homogeneous coordinates (a, ρ) with a = d + ρ c. It lights the plane at q with
// a_z/|d − ρ (q − c)|³, relative to d_z at the centre. For ρ = 0 both are as for distant light.
#pragma once

#include <span>
#include <utility>

#include "fastibl/scene/near_light.h"
#include "fastibl/shadow/triangle_bits.h"

namespace fastibl {

class NearPlane {
 public:
  NearPlane() = default;
  explicit NearPlane(NearLights near_lights) : near_lights_(std::move(near_lights)) {}

  int count() const { return int(near_lights_.lights.size()); }
  // The index of the light that a direction above the horizon belongs to; −1 for none, or for a
  // light that is not above the plane.
  int light_of(glm::vec3 direction) const;
  // For a direction of light i, and for what is on the plane as if it were moved by −shift.
  PlaneProjection projection(glm::vec3 direction, int i, glm::vec2 shift) const;
  glm::dvec3 position(glm::vec3 direction, int i) const;
  // The light of a direction of light i on the plane is its light at the map's centre, times
  // height(), times falloff().
  float height(glm::vec3 direction, int i) const;
  void falloff(int i, std::span<const glm::vec2> points, std::span<float> falloffs) const;
  float height(int i) const {  // that of its middle
    return height(near_lights_.lights[std::size_t(i)].direction, i);
  }

  // Whether other lights are so similar that what was drawn for these may stay: to half a percent
  // of the distance, and a quarter of a degree.
  bool still_right(const NearLights& others) const;

 private:
  NearLights near_lights_;
};

}  // namespace fastibl
