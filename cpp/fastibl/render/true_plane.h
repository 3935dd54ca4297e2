// What the object truly does to the plane's light at the samples of a scene, see true_light.h.
#pragma once

#include <cstddef>
#include <vector>

#include "fastibl/render/scene_samples.h"
#include "fastibl/render/true_light.h"
#include "fastibl/render/true_near.h"

namespace fastibl {

inline constexpr float kPlaneLevel = 0.35f;  // of the plane in the picture, as a share of white

// What is true on the plane, and which places count.
struct PlaneTruth {
  std::vector<glm::vec3> ratio,
      added;  // the shadow's; the object's light there, divided by the plane's own
  std::vector<std::size_t> counted;
};

// sent: what the samples send to the plane.
PlaneTruth plane_truth(const SceneSamples& samples, const SampleFlux& flux,
                       const BrightPieces& bright, const NearTruth& near_lights,
                       const std::vector<glm::vec3>& sent);

// Whether this factor on the plane's light changes the plane's picture by more than a code.
bool shows_on_plane(glm::vec3 gain);

}  // namespace fastibl
