#include "fastibl/shading/light_disc.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "fastibl/core/lanes.h"

namespace fastibl {

float disc_in_lobe(glm::vec3 arrow, float sin_radius, float flux, glm::vec3 normal, glm::vec3 view,
                   const LobeHeight& lobe) {
  constexpr int kPoints = 32;
  static_assert(kPoints % kLanes == 0);
  // The closer, the larger; it may become half of all directions. In its middle, any will do.
  const float size = glm::length(arrow), length = std::max(size, sin_radius),
              sine = sin_radius / length;
  const DiscPoints<kPoints> points(size > 0 ? arrow / size : normal, sine);
  std::array<float, kPoints> fluxes, weights;
  fluxes.fill(flux / (length * length * float(kPoints)));
  const LitDirections lit{
      points.x, points.y, points.z, fluxes.data(), {fluxes.data(), fluxes.data(), fluxes.data()},
      kPoints};
  const float apart = std::sqrt(kPi / float(kPoints)) * sine;
  weigh_squares(lit, apart, normal, view, lobe, weights.data());
  float sum = 0;
  for (const float w : weights) sum += w;
  return sum;
}

}  // namespace fastibl
