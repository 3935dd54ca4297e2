#include "fastibl/lighting/fit_lighting.h"

#include <algorithm>
#include <cstdint>
#include <span>

#include "fastibl/core/check.h"
#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/lighting/fit_glossy_chain.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/fit_prefiltered_chain.h"
#include "fastibl/lighting/harmonic_sums.h"
#include "fastibl/scene/room_box.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

GlossySettings resolved(GlossyMethod method, GlossySettings settings) {
  if (method == GlossyMethod::centroid) settings.taps = 1;
  if (method == GlossyMethod::prefiltered) settings.lights = 0;
  if (settings.taps == 0) settings.taps = method == GlossyMethod::sampled ? 64 : 3;
  if (settings.lights < 0) settings.lights = kMaxLights;
  return settings;
}

// Finer than what methods sum, as small lights lie elsewhere in a coarse level's texels.
constexpr int kErrorSumSize = 128;

}  // namespace

bool reads_chain(GlossyMethod method) {
  return method == GlossyMethod::centroid || method == GlossyMethod::stretched ||
         method == GlossyMethod::prefiltered;
}

namespace {

// For a light: that of the near light it belongs to, or else of the wall behind it.
float inverse_distance(const Lighting& lighting, glm::vec3 direction) {
  const float own = lighting.near_lights.inverse_distance(direction);
  if (own > 0 || !lighting.box) return own;
  const WallsAround walls(*lighting.box, lighting.near_lights.centre);
  return 1 / glm::length(walls.direction(direction, glm::vec3(0)));
}

void make_chain(Lighting& lighting, const std::shared_ptr<const GlossyChain>& previous) {
  const bool exact = lighting.glossy == GlossyMethod::prefiltered;
  const int most = lighting.glossy_settings.lights;
  if (previous && previous->map == lighting.radiance && previous->exact == exact &&
      previous->most_lights == most) {
    lighting.chain = previous;
    return;
  }
  if (exact) {
    lighting.chain = fit_prefiltered_chain(lighting.radiance);
    return;
  }
  check(lighting.radiance != nullptr, "the lighting has no map");
  const CubeLevel source = working_level(*lighting.radiance);
  std::vector<FoundLight> lights;
  // With the same map nothing fades, as no later map may come to end the fading.
  if (previous && previous->map != lighting.radiance) {
    const CubeLevel level = working_level(*previous->map);
    const LightsBefore before{previous->lights, level};
    lights = find_lights(*lighting.radiance, source, most, &before);
  } else {
    lights = find_lights(*lighting.radiance, source, most);
  }
  std::shared_ptr<GlossyChain> chain = fit_glossy_chain(lighting.radiance, source, lights);
  chain->most_lights = most;
  lighting.chain = std::move(chain);
}

}  // namespace

void fit_chain(Lighting& lighting, const std::shared_ptr<const GlossyChain>& previous) {
  make_chain(lighting, previous);
  lighting.light_distances.clear();
  for (const Light& light : lighting.chain->lights)
    lighting.light_distances.push_back(inverse_distance(lighting, light.direction));
}

void fit_near_radiance(Lighting& lighting, const std::shared_ptr<const CubeMap>& known) {
  lighting.near_radiance.reset();
  if (lighting.glossy != GlossyMethod::sampled || lighting.near_lights.empty()) return;
  if (known) {
    lighting.near_radiance = known;
    return;
  }
  NearLights shown = lighting.near_lights;
  shown.lights.resize(std::min(shown.lights.size(), kMostSampledNear));
  lighting.near_radiance =
      std::make_shared<const CubeMap>(near_radiance(*lighting.radiance, shown));
}

double irradiance_error(Lighting& lighting) {
  if (!lighting.irradiance_error && lighting.radiance)
    lighting.irradiance_error =
        measure_error(lighting.irradiance, fold(*lighting.radiance, kErrorSumSize));
  return lighting.irradiance_error.value_or(0);
}

void ensure_chain(Lighting& lighting) {
  if (lighting.radiance && !lighting.chain && reads_chain(lighting.glossy)) fit_chain(lighting);
}

Lighting fit_lighting(std::shared_ptr<const CubeMap> radiance, const LightingOptions& options,
                      const Lighting* previous) {
  check(radiance && radiance->size() > 0, "lighting needs a map");
  Lighting lighting;
  const std::span<const std::uint64_t> versions = radiance->tile_versions();
  lighting.versions.assign(versions.begin(), versions.end());
  // Of a map that was written to since, nothing is as it was.
  if (previous && previous->radiance == radiance && previous->versions != lighting.versions)
    previous = nullptr;
  lighting.glossy =
      options.glossy == GlossyMethod::automatic ? GlossyMethod::centroid : options.glossy;
  check_settings(options.diffuse, options.diffuse_settings);
  check_settings(lighting.glossy, options.glossy_settings);
  lighting.glossy_settings = resolved(lighting.glossy, options.glossy_settings);
  lighting.normalization = options.normalization;
  if (options.irradiance) {
    // The same map is fitted anew, so that it gives the same result again.
    const bool moved = previous && previous->has_irradiance && previous->radiance != radiance;
    lighting.has_irradiance = true;
    const FoldedMap map = fold(*radiance, kSumSize);
    lighting.irradiance = fit_irradiance(
        *radiance, map,
        {options.diffuse, options.diffuse_settings, options.evaluations, options.follows},
        moved ? &previous->irradiance : nullptr);
    lighting.plane_irradiance = glm::vec3(plane_irradiance(map));
    if (options.measure_error) lighting.irradiance_error = measure_error(lighting.irradiance, map);
  } else {
    lighting.irradiance_error = 0;
    if (options.plane)
      lighting.plane_irradiance = glm::vec3(plane_irradiance(fold(*radiance, kSumSize)));
  }
  lighting.radiance = std::move(radiance);
  if (options.environment) {
    const NearLights* before = options.follows && previous ? &previous->near_lights : nullptr;
    const bool same = before && previous->radiance == lighting.radiance;
    lighting.near_lights = same ? *before : find_near_lights(*options.environment, before);
    fit_near_radiance(lighting, same ? previous->near_radiance : nullptr);
    lighting.box = options.environment->box;
  }
  if (options.chain && reads_chain(lighting.glossy))
    fit_chain(lighting, previous ? previous->chain : nullptr);
  return lighting;
}

}  // namespace fastibl
