#include "fastibl/render/true_near.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "fastibl/render/true_light.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

NearTruth::NearTruth(const NearLights& near_lights, BrightPieces& bright) : lights_(near_lights) {
  if (empty()) return;
  cut_ = bright.cut;
  taken_.assign(cut_.size(), glm::vec3(0));
  for (std::size_t i = 0; i < bright.lit.size(); ++i) {
    const glm::vec3 d = bright.lit.direction(i);
    const NearLight* light = lights_.towards(d);
    if (!light) continue;
    const float solid_angle = bright.lit.solid_angles[i];
    const glm::vec3 own = glm::max(bright.lit.flux(i) - solid_angle * light->around, 0.0f);
    distant_.add(d, solid_angle, own);
    inverse_distances_.push_back(light->inverse_distance);
    taken_[bright.cut_texels[i / BrightPieces::kCount]] += own;
    for (int c = 0; c < 3; ++c) bright.lit.channels[c][i] -= own[c];
  }
  distant_.pad();
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

const NearLight* NearTruth::own(glm::vec3 direction) const {
  if (empty() || !cut_[SceneSamples::direction_at(direction)]) return nullptr;
  return lights_.towards(direction);
}

glm::vec3 NearTruth::without(glm::vec3 direction, glm::vec3 radiance) const {
  const NearLight* light = own(direction);
  return light ? glm::min(radiance, light->around) : radiance;
}

glm::vec3 NearTruth::taken(std::size_t direction) const {
  return empty() ? glm::vec3(0) : taken_[direction];
}

float NearTruth::nearness(glm::vec3 from) const {
  float nearest = std::numeric_limits<float>::infinity();
  for (const NearLight& light : lights_.lights)
    nearest =
        std::min(nearest, glm::length(shared::near_arrow(light.direction, light.inverse_distance,
                                                         from - lights_.centre)));
  return nearest;
}

// A light is on the sphere around the map's centre that goes through its middle.
glm::vec3 NearTruth::radiance(const CubeLevel& level, glm::vec3 from, glm::vec3 direction,
                              glm::vec3 radiance) const {
  glm::vec3 result = without(direction, radiance);
  for (const NearLight& light : lights_.lights) {
    const glm::vec3 offset = light.inverse_distance * (from - lights_.centre);
    const float along = glm::dot(offset, direction),
                inside = along * along - glm::dot(offset, offset) + 1;
    if (!(inside >= 0)) continue;
    for (const float way : {-along - std::sqrt(inside), -along + std::sqrt(inside)}) {
      const glm::vec3 met = offset + way * direction;
      if (way > 0 && own(met) == &light) result += glm::max(level.sample(met) - light.around, 0.0f);
    }
  }
  return result;
}

}  // namespace fastibl
