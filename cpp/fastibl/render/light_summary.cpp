#include "fastibl/render/light_summary.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr int kCoarse = 16;             // texels along a face that light is summed over
constexpr float kCompact = 8;           // times the mean radiance: above it, light is compact
constexpr float kLittleChange = 0.25f;  // shares of the light
constexpr float kOtherLight = 0.1f, kOtherCompactLight = 0.05f, kOtherNear = 0.1f;

}  // namespace

LightSummary summary_of(const CubeMap& map) {
  LightSummary light;
  const CubeLevel& top = map.level(map.level_count() - 1);
  glm::vec3 mean(0);
  for (int f = 0; f < 6; ++f) mean += (light.faces[std::size_t(f)] = top.texel(f, 0, 0)) / 6.0f;
  const CubeLevel& level = map.level_at_most(kCoarse);
  const float all = mean.x + mean.y + mean.z, limit = kCompact * all;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < level.size(); ++y)
      for (int x = 0; x < level.size(); ++x) {
        const glm::vec3 texel = level.texel(f, x, y);
        light.compact += std::max(texel.x + texel.y + texel.z - limit, 0.0f);
      }
  const float texels = 6.0f * float(level.size()) * float(level.size());
  light.compact = all > 0 ? light.compact / (texels * all) : 0;
  return light;
}

float near_change(const LightSummary& distant, const NearLights& near_lights, glm::vec3 place,
                  float reach) {
  constexpr float kClosest = 1e-3f;  // a place inside a light, by the light's distance
  constexpr float kMost = 2;
  float changed = 0, all = 0;
  for (const NearLight& light : near_lights.lights) {
    const glm::vec3 arrow =
        shared::near_arrow(light.direction, light.inverse_distance, place - near_lights.centre);
    const float length = std::max(glm::length(arrow), kClosest);
    const glm::vec3 here = arrow / (length * length * length);
    const float facing = light.irradiance.x + light.irradiance.y + light.irradiance.z;
    const float varies = std::min(2 * light.inverse_distance * reach / length, 1.0f);
    all += facing * glm::length(here);
    changed += facing * (glm::length(here - light.direction) + varies * glm::length(here));
  }
  for (const glm::vec3& mean : distant.faces) all += kPi / 6 * (mean.x + mean.y + mean.z);
  return all > 0 ? std::min(changed / all, kMost) : 0;
}

bool has_light(const CubeMap& map) {
  const CubeLevel& top = map.level(map.level_count() - 1);
  for (int f = 0; f < 6; ++f)
    if (top.texel(f, 0, 0) != glm::vec3(0)) return true;
  return false;
}

float difference(const LightSummary& a, const LightSummary& b) {
  float off = 0, all = 0;
  for (std::size_t f = 0; f < a.faces.size(); ++f)
    for (int c = 0; c < 3; ++c)
      off += std::abs(a.faces[f][c] - b.faces[f][c]), all += std::max(a.faces[f][c], b.faces[f][c]);
  return all > 0 ? off / all : 0;
}

bool is_little_change(const LightSummary& a, const LightSummary& b) {
  return difference(a, b) <= kLittleChange;
}

bool is_other_light(const LightSummary& a, const LightSummary& b) {
  return difference(a, b) > kOtherLight || std::abs(a.compact - b.compact) > kOtherCompactLight ||
         std::abs(a.nearby - b.nearby) > kOtherNear;
}

}  // namespace fastibl
