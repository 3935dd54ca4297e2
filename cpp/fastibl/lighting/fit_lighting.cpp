#include "fastibl/lighting/fit_lighting.h"

#include "fastibl/core/check.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/irradiance_sums.h"

namespace fastibl {

Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options,
                      const Lighting* previous) {
  check(radiance && radiance->size() > 0, "lighting needs a map");
  Lighting lighting;
  lighting.glossy = options.glossy == GlossyMethod::automatic ? GlossyMethod::mip : options.glossy;
  lighting.glossy_settings = options.glossy_settings;
  lighting.normalization = options.normalization;
  if (options.irradiance) {
    lighting.irradiance = fit_irradiance(*radiance, options.diffuse, options.diffuse_settings,
                                         previous ? &previous->irradiance : nullptr);
    const FoldedMap map = fold(*radiance, kPlaneSize);
    lighting.plane_irradiance = glm::vec3(sum_irradiance(map, {0, 0, 1}));
    if (options.measure_error) lighting.irradiance_error = measure_error(lighting.irradiance, map);
  }
  lighting.radiance = std::move(radiance);
  return lighting;
}

}  // namespace fastibl
