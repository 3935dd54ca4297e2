// Bright lobes beside nine spherical harmonics.
#pragma once

#include "fastibl/lighting/octant_grid.h"
#include "fastibl/scene/irradiance.h"

namespace fastibl {

struct LobesOptions {
  int count = -1;                   // -1: as many as it takes to be within `error`
  float error = 0.004f;             // RMS of what is left, relative to the mean irradiance
  const Lobes* previous = nullptr;  // of the frame before: moved along instead of searched anew
};

// The irradiance of a distant light is max(n·d, 0). Fits Σ a_k max(n·d_k, 0), less its own nine
// coefficients, to what nine coefficients leave of the map's irradiance: directions and amplitudes
// together, by least squares over the sphere, amplitudes not negative. What is left and the lobes
// are even under n → −n, so only half the sphere is fitted. The map's own coefficients stay as they
// are; lobe_polynomial() must be subtracted from them.
Lobes fit_lobes(const FoldedMap& map, const std::array<glm::vec3, 9>& polynomial,
                const LobesOptions& options);

// The part of Σ a_k max(n·d_k, 0) that nine coefficients hold, in the form of Irradiance.
std::array<glm::vec3, 9> lobe_polynomial(const Lobes& lobes);

}  // namespace fastibl
