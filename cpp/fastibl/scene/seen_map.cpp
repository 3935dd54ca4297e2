#include "fastibl/scene/seen_map.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

glm::vec3 nearest_texel(const CubeLevel& level, glm::vec3 direction) {
  const TexelPlace at = texel_at(direction, level.size());
  return level.texel(at.face, at.x, at.y);
}

glm::vec3 filtered(const CubeMap& map, glm::vec3 l, float solid_angle, float texel_share) {
  const glm::vec3 a = glm::abs(l);
  const float major = std::max({a.x, a.y, a.z}), n = float(map.size());
  const float texel = 4 / (n * n) * major * major * major;
  const float level = 0.5f * std::log2(std::max(solid_angle, 1e-30f) / texel);
  if (level >= 0 || texel_share <= 0) return map.sample(l, level);
  // Goes from the blend between texels to the texels themselves where four to sixteen taps fall on
  // each; fewer taps would count texels unevenly.
  const float share = texel_share * std::clamp(-level - 1, 0.0f, 1.0f);
  const glm::vec3 texels = nearest_texel(map.level(0), l);
  return share >= 1 ? texels : glm::mix(map.sample(l, 0), texels, share);
}

}  // namespace

SeenMap::SeenMap(const Lighting& lighting, const std::optional<WallsAround>& walls,
                 const glm::vec3* place)
    : map_(lighting.radiance.get()) {
  if (!place) return;
  walls_ = walls ? &*walls : nullptr, offset_ = *place - lighting.near_lights.centre;
  if (!lighting.near_radiance) return;
  near_ = lighting.near_radiance.get(), lights_ = lighting.near_lights.lights;
  lights_ = lights_.first(std::min(lights_.size(), kMostSampledNear));
}

glm::vec3 SeenMap::mean(glm::vec3 d, float solid_angle, float texel_share) const {
  const glm::vec3 looked = walls_ ? glm::normalize(walls_->direction(d, offset_)) : d;
  const glm::vec3 all = filtered(*map_, looked, solid_angle, texel_share);
  if (!near_) return all;
  return glm::max(all - filtered(*near_, looked, solid_angle, texel_share), 0.0f) +
         of_near_lights(d, solid_angle, texel_share);
}

// A light is on the sphere around the centre that goes through its middle; what the map has there
// is the nearest light's.
glm::vec3 SeenMap::of_near_lights(glm::vec3 d, float solid_angle, float texel_share) const {
  glm::vec3 sum(0);
  for (const NearLight& light : lights_) {
    const glm::vec3 from = light.inverse_distance * offset_;
    const glm::vec2 ways = shared::sphere_crossings(d, from);
    for (const float way : {ways.x, ways.y}) {
      if (!(way > 0)) continue;
      const glm::vec3 met = from + way * d;
      const float along = glm::dot(met, light.direction);
      if (std::ranges::any_of(lights_, [&](const NearLight& other) {
            return glm::dot(met, other.direction) > along;
          }))
        continue;
      sum += filtered(*near_, met, way * way * solid_angle, texel_share);
    }
  }
  return sum;
}

}  // namespace fastibl
