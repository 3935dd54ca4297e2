// Radiance filtered with round lobes of growing width: what glossy surfaces are looked up in.
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
  glm::vec3 window{0, 0, 1};     // middle of the disc that it was looked for in
  float strength = 1;            // share of the disc's light that it holds; the map keeps the rest
  bool operator==(const Light&) const = default;
};
inline constexpr int kMaxLights = 8;

// What a light takes from a texel of the level that it was found on.
struct TakenTexel {
  int face, x, y;
  glm::vec3 radiance;
};

// Levels 0 … 7. Level 0 is the map itself. Level k ≥ 1 holds at each direction the mean of the
// radiance under the lobe ((1 + cos δ)/2)^{e/2} cos δ, e = 8192/4^{k−1}: half-vector exponent e at
// normal incidence, standard deviation 2/√e along each axis, twice that of the level before. From
// level 2 on that is 1.8 texels, so that bilinear look-ups hardly change the lobe.
struct GlossyChain {
  static constexpr int kLevelCount = 8;
  static constexpr std::array<int, kLevelCount> kSizes = {0, 64, 64, 32, 16, 8, 4, 2};
  static constexpr float kFinestWidth = 0.022097087f;  // of level 1: 2/√8192 radians

  std::shared_ptr<const CubeMap> map;
  std::array<CubeLevel, kLevelCount> lobes;  // [0] is empty: level 0 is in `map`
  // Spherical harmonics (order as project_sh9) of the map without its lights, up to order 4, times
  // the constants of the basis.
  std::array<glm::vec3, 25> harmonics{};
  // Lights that were taken out of levels, wholly or in part: they are to be shaded by themselves.
  std::vector<Light> lights;
  std::vector<TakenTexel> taken;  // by all of them, of 64² faces
  int most_lights = 0;            // that were asked for
  bool exact = false;             // convolved with the lobes themselves, by `prefiltered`
  // Where each light's own width lies among the levels.
  std::vector<float> light_levels;

  const CubeLevel& level(int k) const { return k == 0 ? map->level(0) : lobes[std::size_t(k)]; }

  // Standard deviation of level 0 along each axis: a texel read bilinearly has half its width.
  float own_width() const;
  // Level whose lobe has this standard deviation along each axis, radians; clamped to the chain.
  float level_of(float width) const;
  // Radiance under a lobe; the direction has any length but 0. Seamless, level clamped.
  glm::vec3 sample(glm::vec3 direction, float level) const;
  // The share of light i that look-ups at this level do not hold.
  float light_share(std::size_t i, float level) const;
};

// Lights narrower than a level's lobe are taken out of it: all of them one level later.
inline float light_taken(int level, float light_level) {
  const float share = float(level) - light_level;
  return share > 0 ? (share < 1 ? share : 1.0f) : 0.0f;
}

}  // namespace fastibl
