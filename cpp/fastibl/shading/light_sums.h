// Sums over directions with light: the irradiance of a place and the light in its lobe, with and
// without what is hidden.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/material.h"

namespace fastibl {

// Height of a material's lobe towards a direction; none without one.
struct LobeHeight {
  bool any = false, ggx = false;
  float exponent = 0, alpha2 = 0, f0 = 1;
  float least = 0;  // n·h: below it there is 1e-4 of the peak

  // Sharper lobes than of exponent `sharpest` fall between the directions: they are taken for it.
  LobeHeight(const std::optional<LobeShape>& shape, float sharpest);
};

// Directions one after the other, as many as fill whole Lanes: unit vectors, and the radiance of
// each channel times the solid angle.
struct LitDirections {
  const float *x, *y, *z, *solid_angles;
  const float* channels[3];
  std::size_t count;
};

struct LightSums {
  float irradiance[3], open_irradiance[3];  // of what is free, and of all
  float lobe[3], open_lobe[3];              // by the height of the lobe, likewise
  float height;                             // ∫ of the lobe
  float open_squares;                       // of the parts of open_lobe, their channels summed
};
// free: of each direction; those below the tangent plane count for nothing.
void sum_light(const LitDirections& directions, const std::uint8_t* free, const glm::vec3& normal,
               const glm::vec3& view, const LobeHeight& lobe, LightSums& out);

}  // namespace fastibl
