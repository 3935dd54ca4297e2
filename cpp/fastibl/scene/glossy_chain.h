// Radiance filtered with round lobes of growing width, in which glossy surfaces are looked up.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "fastibl/scene/cube_map.h"

namespace fastibl {

// A small bright part of the map: a disc of equal radiance.
struct Light {
  glm::vec3 direction{0, 0, 1};  // towards it, unit length
  float angular_radius = 0;      // radians; half of it is the standard deviation along each axis
  glm::vec3 irradiance{0};       // on a surface that faces it
  glm::vec3 flux{0};             // radiance summed over its solid angle
  glm::vec3 window{0, 0, 1};     // middle of the disc in which it was searched for
  float strength = 1;            // share of the disc's light that it holds; the map keeps the rest
  bool operator==(const Light&) const = default;
};
inline constexpr int kMaxLights = 8;

// What a light takes from a texel of the level on which it was found.
struct TakenTexel {
  int face, x, y;
  glm::vec3 radiance;
};

// Levels 0 … 7. Level 0 is the map itself. Level k ≥ 1 holds for each direction the mean radiance
// under the lobe ((1 + cos δ)/2)^{e/2} cos δ, e = 8192/4^{k−1}: a half-vector exponent of e at
// normal incidence, and a standard deviation of 2/√e along each axis, twice that of the level
// before. From level 2 on that is 1.8 texels, so that bilinear look-ups hardly change the lobe.
struct GlossyChain {
  static constexpr int kLevelCount = 8;
  static constexpr std::array<int, kLevelCount> kSizes = {0, 64, 64, 32, 16, 8, 4, 2};
  static constexpr float kFinestWidth = 0.022097087f;  // of level 1: 2/√8192 radians

  std::shared_ptr<const CubeMap> map;
  std::array<CubeLevel, kLevelCount> lobes;  // [0] is empty: level 0 is in `map`
  // Spherical harmonics (in the order of project_sh9) of the map without its lights, up to order 4,
  // times the constants of the basis.
  std::array<glm::vec3, 25> harmonics{};
  // Lights that were taken out of levels, wholly or in part: they must be shaded by themselves.
  std::vector<Light> lights;
  std::vector<TakenTexel> taken;  // by all lights together, on 64² faces
  int most_lights = 0;            // number that was asked for
  bool exact = false;             // convolved with the lobes themselves, by `prefiltered`
  // For each light, the level that its own width corresponds to.
  std::vector<float> light_levels;

  const CubeLevel& level(int k) const { return k == 0 ? map->level(0) : lobes[std::size_t(k)]; }

  // Standard deviation of level 0 along each axis: half a texel's width, for bilinear reading.
  float own_width() const;
  // The level whose lobe has this standard deviation along each axis, radians; clamped to the
  // chain.
  float level_of(float width) const;
  // Radiance under a lobe; the direction may have any length but 0. Seamless; the level is clamped.
  glm::vec3 sample(glm::vec3 direction, float level) const;
  // The share of light i that look-ups at this level do not hold.
  float light_share(std::size_t i, float level) const;
};

// The share of a light that is taken out of a level. Levels whose lobe is wider than the light lack
// part of it; from one level later on they lack all of it.
inline float light_taken(int level, float light_level) {
  const float share = float(level) - light_level;
  return share > 0 ? (share < 1 ? share : 1.0f) : 0.0f;
}

}  // namespace fastibl
