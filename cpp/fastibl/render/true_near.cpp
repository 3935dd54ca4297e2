#include "fastibl/render/true_near.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "fastibl/render/true_light.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

NearTruth::NearTruth(const NearLights& near_lights, BrightPieces& bright) : lights_(near_lights) {
  if (empty()) return;
  std::vector<int> of(bright.lit.size());
  struct Facing {  // sums over the pieces of a light, by their cosines to its middle
    glm::vec3 light{0};
    float solid_angle = 0;
  };
  std::vector<Facing> facing(lights_.lights.size());
  for (std::size_t i = 0; i < of.size(); ++i) {
    const glm::vec3 d = bright.lit.direction(i);
    of[i] = light_towards(d);
    if (of[i] < 0) continue;
    const auto l = std::size_t(of[i]);
    const float cosine = std::max(glm::dot(d, lights_.lights[l].direction), 0.0f);
    facing[l].light += cosine * bright.lit.flux(i);
    facing[l].solid_angle += cosine * bright.lit.solid_angles[i];
  }
  for (std::size_t l = 0; l < facing.size(); ++l)
    around_.push_back(glm::max(facing[l].light - lights_.lights[l].irradiance, 0.0f) /
                      std::max(facing[l].solid_angle, 1e-12f));
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (of[i] < 0) continue;
    const auto l = std::size_t(of[i]);
    const float solid_angle = bright.lit.solid_angles[i];
    const glm::vec3 own = glm::max(bright.lit.flux(i) - solid_angle * around_[l], 0.0f);
    distant_.add(bright.lit.direction(i), solid_angle, own);
    inverse_distances_.push_back(lights_.lights[l].inverse_distance);
    for (int c = 0; c < 3; ++c) bright.lit.channels[c][i] -= own[c];
  }
  distant_.pad();
}

int NearTruth::light_towards(glm::vec3 direction) const {
  const NearLight* light = lights_.towards(direction);
  return light ? int(light - lights_.lights.data()) : -1;
}

void NearTruth::look(glm::vec3 from, LitList& seen) const {
  constexpr float kClosest = 1e-6f;  // square of a distance, by that from the centre
  seen.clear();
  for (std::size_t i = 0; i < inverse_distances_.size(); ++i) {
    const glm::vec3 arrow =
        shared::near_arrow(distant_.direction(i), inverse_distances_[i], from - lights_.centre);
    const float length2 = std::max(glm::dot(arrow, arrow), kClosest);
    seen.add(arrow / std::sqrt(length2), distant_.solid_angles[i] / length2,
             distant_.flux(i) / length2);
  }
  seen.pad();
}

// A light is on the sphere around the map's centre that goes through its middle.
glm::vec3 NearTruth::radiance(const CubeLevel& level, glm::vec3 from, glm::vec3 direction,
                              glm::vec3 radiance) const {
  if (empty()) return radiance;
  glm::vec3 result = radiance;
  if (const int own = light_towards(direction); own >= 0)
    result = glm::min(result, around_[std::size_t(own)]);
  for (std::size_t l = 0; l < lights_.lights.size(); ++l) {
    const glm::vec3 offset = lights_.lights[l].inverse_distance * (from - lights_.centre);
    const float along = glm::dot(offset, direction), beyond = glm::dot(offset, offset) - 1;
    if (!(beyond < 0)) continue;
    const glm::vec3 met = offset + (std::sqrt(along * along - beyond) - along) * direction;
    if (light_towards(met) == int(l)) result += glm::max(level.sample(met) - around_[l], 0.0f);
  }
  return result;
}

}  // namespace fastibl
