#include "fastibl/lighting/fit_lighting.h"

#include "fastibl/core/check.h"
#include "fastibl/lighting/fit_glossy_chain.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/irradiance_sums.h"

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

void fit_chain(Lighting& lighting, const std::shared_ptr<const GlossyChain>& previous) {
  const int most = lighting.glossy_settings.lights;
  if (previous && previous->map == lighting.radiance && previous->most_lights == most) {
    lighting.chain = previous;
    return;
  }
  const CubeLevel source = working_level(*lighting.radiance);
  const std::span<const Light> followed = previous ? previous->lights : std::span<const Light>();
  const std::vector<FoundLight> lights = find_lights(*lighting.radiance, source, most, followed);
  std::shared_ptr<GlossyChain> chain = fit_glossy_chain(lighting.radiance, source, lights);
  chain->most_lights = most;
  chain->followed.assign(followed.begin(), followed.end());
  lighting.chain = std::move(chain);
}

Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options) {
  check(radiance && radiance->size() > 0, "lighting needs a map");
  Lighting lighting;
  lighting.glossy =
      options.glossy == GlossyMethod::automatic ? GlossyMethod::centroid : options.glossy;
  lighting.glossy_settings = resolved(lighting.glossy, options.glossy_settings);
  lighting.normalization = options.normalization;
  if (options.irradiance) {
    lighting.irradiance = fit_irradiance(*radiance, options.diffuse, options.diffuse_settings);
    const FoldedMap map = fold(*radiance, kPlaneSize);
    lighting.plane_irradiance = glm::vec3(sum_irradiance(map, {0, 0, 1}));
    if (options.measure_error) lighting.irradiance_error = measure_error(lighting.irradiance, map);
  }
  lighting.radiance = std::move(radiance);
  if (options.chain && reads_chain(lighting.glossy)) fit_chain(lighting, options.previous);
  return lighting;
}

}  // namespace fastibl
