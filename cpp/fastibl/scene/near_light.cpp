#include "fastibl/scene/near_light.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace fastibl {
namespace {

// A light's texels, and parts of it that were looked for separately, lie within this many times its
// angular radius plus so many radians.
constexpr float kOutline = 1.5f, kBeside = 0.05f;

}  // namespace

const NearLight* NearLights::towards(glm::vec3 direction) const {
  const NearLight* nearest = nullptr;
  float least = std::numeric_limits<float>::infinity();  // angle relative to what is allowed
  for (const NearLight& light : lights) {
    const float angle = std::acos(std::clamp(glm::dot(direction, light.direction), -1.0f, 1.0f));
    const float part = angle / (kOutline * std::asin(std::min(light.sin_radius, 1.0f)) + kBeside);
    if (part < std::min(least, 1.0f)) least = part, nearest = &light;
  }
  return nearest;
}

glm::vec3 most_change(const NearLights& near_lights, float reach) {
  glm::vec3 change(0);
  for (const NearLight& light : near_lights.lights) {
    const float left = 1 - light.inverse_distance * reach;
    change += light.irradiance *
              (left > 0 ? 1 / (left * left) - 1 : std::numeric_limits<float>::infinity());
  }
  return change;
}

}  // namespace fastibl
