// Sums over lit directions: the irradiance of a place and the light in its lobe, with and without
// what is hidden.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/material.h"

namespace fastibl {

// Height of a material's lobe towards a direction; `any` is false without a lobe.
struct LobeHeight {
  bool any = false, ggx = false;
  float exponent = 0, alpha2 = 0, f0 = 1;
  float least = 0;  // n·h: below it the lobe is under 1e-4 of its peak

  // Lobes sharper than exponent `sharpest` are taken to have that exponent.
  explicit LobeHeight(const std::optional<LobeShape>& shape,
                      float sharpest = std::numeric_limits<float>::infinity());
};

// Directions one after the other, padded to whole Lanes: unit vectors, and the radiance of each
// channel times the solid angle.
struct LitDirections {
  const float *x, *y, *z, *solid_angles;
  const float* channels[3];
  std::size_t count;
};

struct LightSums {
  float irradiance[3], open_irradiance[3];  // of the free directions, and of all
  float lobe[3], open_lobe[3];              // weighted by the height of the lobe, likewise
  float height;                             // ∫ of the lobe
  float open_squares;                       // of the terms of open_lobe, their channels summed
};
// free: for each direction; those below the tangent plane do not count.
void sum_light(const LitDirections& directions, const std::uint8_t* free, const glm::vec3& normal,
               const glm::vec3& view, const LobeHeight& lobe, LightSums& out);
// Height of the lobe times the first channel, for each direction; these are the middles of squares,
// and the lobe is taken to be wider by about half their width (radians).
void weigh_squares(const LitDirections& directions, float width, const glm::vec3& normal,
                   const glm::vec3& view, const LobeHeight& lobe, float* weights);

}  // namespace fastibl
