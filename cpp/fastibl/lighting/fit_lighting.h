// From a map to what shading reads.
#pragma once

#include <memory>

#include "fastibl/scene/lighting.h"

namespace fastibl {

struct LightingOptions {
  DiffuseMethod diffuse = DiffuseMethod::automatic;
  DiffuseSettings diffuse_settings;
  GlossyMethod glossy = GlossyMethod::automatic;
  GlossySettings glossy_settings;
  Normalization normalization = Normalization::energy;
  bool irradiance = true;     // false: only what glossy surfaces read
  bool measure_error = true;  // also compare the irradiance with a sum over the 32² level (0.05 ms)
  int evaluations = 0;        // how many normals follow; 0: many. `automatic` goes by it
};
// previous: of the frame before, or null. What was found then is moved along instead of searched
// anew, which is faster, and steady.
Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options = {},
                      const Lighting* previous = nullptr);

}  // namespace fastibl
