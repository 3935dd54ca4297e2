#include "fastibl/lighting/fit_lighting.h"

#include "fastibl/core/check.h"
#include "fastibl/lighting/fit_glossy_chain.h"
#include "fastibl/lighting/fit_irradiance.h"

namespace fastibl {
namespace {

GlossySettings resolved(GlossyMethod method, GlossySettings settings) {
  if (method == GlossyMethod::centroid) settings.taps = 1;
  if (settings.taps == 0) settings.taps = method == GlossyMethod::sampled ? 64 : 3;
  if (settings.lights < 0) settings.lights = kMaxLights;
  return settings;
}

}  // namespace

bool reads_chain(GlossyMethod method) {
  return method == GlossyMethod::centroid || method == GlossyMethod::stretched;
}

void fit_chain(Lighting& lighting, std::span<const Light> previous) {
  const CubeLevel source = working_level(*lighting.radiance);
  lighting.chain = fit_glossy_chain(
      lighting.radiance, source,
      find_lights(*lighting.radiance, source, lighting.glossy_settings.lights, previous));
}

Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options) {
  check(radiance && radiance->size() > 0, "lighting needs a map");
  Lighting lighting;
  lighting.glossy = options.glossy == GlossyMethod::automatic ? GlossyMethod::mip : options.glossy;
  lighting.glossy_settings = resolved(lighting.glossy, options.glossy_settings);
  lighting.normalization = options.normalization;
  if (options.irradiance) {
    lighting.irradiance = fit_irradiance(*radiance, options.diffuse, options.diffuse_settings);
    lighting.plane_irradiance = glm::vec3(sum_irradiance(*radiance, {0, 0, 1}));
    if (options.measure_error)
      lighting.irradiance_error = measure_error(lighting.irradiance, *radiance);
  }
  lighting.radiance = std::move(radiance);
  if (options.chain && reads_chain(lighting.glossy)) fit_chain(lighting, options.previous_lights);
  return lighting;
}

}  // namespace fastibl
