// The share of light that the paper's glossy term reflects.
#pragma once

#include <vector>

#include "fastibl/scene/methods.h"

namespace fastibl {

// ρ(θ_v, s) of Eq. 3: the share of light that (s + 8)/(8π) (n·h)^s cos θ reflects. From a 64² table
// over cos θ_v and 1/√(1 + s/8), within 0.002 of quadrature for every s.
inline constexpr int kAlbedoTableSize = 64;
const std::vector<float>&
albedo_table();  // row: exponent coordinate, column: cos θ_v, ends included
float directional_albedo(float cos_view, float exponent);  // cos_view: clamped; NaN counts as 0

// The factor by which ρ is multiplied for a normalisation. With the exact factor
// (s + 2)(s + 4)/(8π(2^{−s/2} + s)) the albedo at normal incidence is 1 for every s.
float albedo_scale(Normalization normalization, float exponent);

}  // namespace fastibl
