// The light of near lights on the marker plane, by that which they send to the map's centre.
//
// A direction d of the map that belongs to a light of inverse distance ρ is a point at d/ρ from the
// centre c: in homogeneous coordinates (a, ρ) with a = d + ρ c. It lights the plane at q with
// a_z/|d − ρ (q − c)|³, by d_z at the centre. For ρ = 0 both are what they are of distant light.
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
  // Of the light that a direction above the horizon belongs to; −1: of none, or one that is not
  // above the plane.
  int light_of(glm::vec3 direction) const;
  // Of a direction of light i, for what is on the plane as if it were moved by −shift.
  PlaneProjection projection(glm::vec3 direction, int i, glm::vec2 shift) const;
  glm::dvec3 position(glm::vec3 direction, int i) const;
  // The light of a direction of light i on the plane is what it is at the map's centre, times
  // height(), times falloff().
  float height(glm::vec3 direction, int i) const;
  void falloff(int i, std::span<const glm::vec2> points, std::span<float> falloffs) const;
  float height(int i) const {  // of its middle
    return height(near_lights_.lights[std::size_t(i)].direction, i);
  }

  // Whether other lights are so much the same that what was drawn of these may stay: to half a
  // percent of the distance, a quarter of a degree.
  bool still_right(const NearLights& others) const;

 private:
  NearLights near_lights_;
};

}  // namespace fastibl
