// What shading needs to know of the light, and how it is read.
#pragma once

#include <memory>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/methods.h"

namespace fastibl {

struct Lighting {
  Irradiance irradiance;
  GlossyMethod glossy = GlossyMethod::mip;  // never `automatic`
  GlossySettings glossy_settings;
  Normalization normalization = Normalization::energy;
  std::shared_ptr<const CubeMap> radiance;  // the chain that glossy reads
  glm::vec3 plane_irradiance{0};            // E(z), summed over the map
  double irradiance_error = 0;  // relative RMS error of `irradiance`, measured on this map
};

// Radiance that a lobe of half-vector exponent s ≥ 0 reflects towards the view (surface to eye),
// both unit vectors: s = 0 is E/π, s = ∞ the mirror.
glm::vec3 evaluate_glossy(const Lighting& lighting, glm::vec3 normal, glm::vec3 view,
                          float exponent);

// ρ(θ_v, s) of Eq. 3: the share of light that (s + 8)/(8π) (n·h)^s cos θ reflects. From a 64² table
// over cos θ_v and 1/√(1 + s/8), within 0.002 of quadrature for every s.
inline constexpr int kAlbedoTableSize = 64;
const std::vector<float>&
albedo_table();  // row: exponent coordinate, column: cos θ_v, ends included
float directional_albedo(float cos_view, float exponent);

}  // namespace fastibl
