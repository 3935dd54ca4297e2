// What light the samples of a scene truly get: sums over all directions of a small level of the
// map, finer where it is bright, and what of them the object hides. What methods are judged by;
// none of them is used.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

// Radiance times solid angle of the samples' directions, channel by channel.
struct SampleFlux {
  std::vector<float> channels[3];
  glm::vec3 plane{0}, all{0};  // E(z), and the sum over all directions

  SampleFlux(const CubeMap& map, const SceneSamples& samples);
  glm::vec3 operator[](std::size_t direction) const {
    return {channels[0][direction], channels[1][direction], channels[2][direction]};
  }
};

// Texels that hold so much of the light that they are no point of it: cut into 4 × 4.
struct BrightPieces {
  static constexpr int kParts = 4, kCount = kParts * kParts;

  std::vector<std::uint8_t> cut;        // of each direction, whether it is
  std::vector<std::size_t> cut_texels;  // those
  // kCount of each: direction, and radiance times solid angle, which sum to the texel's.
  std::vector<float> x, y, z, solid_angles;
  std::vector<float> channels[3];

  BrightPieces(const CubeMap& map, const SceneSamples& samples, const SampleFlux& flux);
  std::size_t count() const { return x.size(); }
  glm::vec3 direction(std::size_t i) const { return {x[i], y[i], z[i]}; }
  glm::vec3 flux(std::size_t i) const { return {channels[0][i], channels[1][i], channels[2][i]}; }
};

// Whether the directions beside one in its face are as it is in `cells`, one number a direction:
// then so are its pieces. What of a texel is hidden is asked by rays at its ends alone.
bool same_around(const std::uint8_t* cells, std::size_t direction);

// One colour a sample of the object.
struct TrueLight {
  std::vector<glm::vec3> irradiance, open_irradiance;  // without what the object hides, and with it
  std::vector<glm::vec3> lobe, open_lobe;  // average radiance under the glossy lobe, likewise
  std::vector<glm::vec3> lost;             // of the irradiance, to the shadow on the plane
};

// With nothing lost to the shadow yet. No lobe: black.
TrueLight true_light(const SceneSamples& samples, const SampleFlux& flux,
                     const BrightPieces& bright, const std::optional<LobeShape>& lobe);

// Sets `lost`: what the plane's shadow keeps from the samples. Every twelfth direction stands for
// twelve, other ones for each sample.
void add_lost(const SceneSamples& samples, const SampleFlux& flux, const ShadowMap& shadow,
              TrueLight& light);

}  // namespace fastibl
