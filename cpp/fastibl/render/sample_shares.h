// What methods give the samples of a scene: their colours, and the share of the light that the
// object leaves to each, (diffuse RGB, glossy).
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/plan/costs.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/material.h"

namespace fastibl {

// Colours of the first `count` samples under some light: with all of their diffuse light and
// nothing glossy, or the other way round.
std::vector<glm::vec3> sample_colours(const SceneSamples& samples, std::size_t count,
                                      const Material& material, const Lighting& lighting,
                                      glm::vec4 share);

// By P_V.
std::vector<glm::vec4> ambient_shares(const SceneSamples& samples);

// By the directions that are free.
std::vector<glm::vec4> transfer_shares(const SceneSamples& samples, const CubeMap& map,
                                       const Irradiance& irradiance, const Material& material);

// Sets those of glossy light: by each sample's lobe, and by what is hidden from the corners around
// it.
void share_by_pixel(const SceneSamples& samples, const CubeMap& map, const Material& material,
                    std::vector<glm::vec4>& shares);

// By rays to the brightest light, and by each sample's lobe: see TracedLights.
LightRays trace_lights(const SceneSamples& samples, const CubeMap& map,
                       const Irradiance& irradiance, const Material& material,
                       std::vector<glm::vec4>& shares);

// Traces the shares, where the object hides anything.
void trace_shares(const SceneSamples& samples, const CubeMap& map, const Material& material,
                  std::vector<glm::vec4>& shares);

}  // namespace fastibl
