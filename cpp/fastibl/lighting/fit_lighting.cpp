#include "fastibl/lighting/fit_lighting.h"

#include "fastibl/core/check.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/irradiance_sums.h"

namespace fastibl {

Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options,
                      const Lighting* previous) {
  check(radiance && radiance->size() > 0, "lighting needs a map");
  if (previous && previous->radiance == radiance) previous = nullptr;  // the same result again
  Lighting lighting;
  lighting.glossy = options.glossy == GlossyMethod::automatic ? GlossyMethod::mip : options.glossy;
  lighting.glossy_settings = options.glossy_settings;
  lighting.normalization = options.normalization;
  if (options.irradiance) {
    const FoldedMap map = fold(*radiance, kSumSize);
    lighting.irradiance = fit_irradiance(
        *radiance, map, {options.diffuse, options.diffuse_settings, options.evaluations},
        previous ? &previous->irradiance : nullptr);
    lighting.plane_irradiance = glm::vec3(sum_irradiance(map, {0, 0, 1}));
    if (options.measure_error) lighting.irradiance_error = measure_error(lighting.irradiance, map);
  }
  lighting.radiance = std::move(radiance);
  return lighting;
}

}  // namespace fastibl
