// Shadow of spheres on the marker plane z = 0, one look-up a sphere: the paper's method. Each
// sphere is a cap of the sky that holds back its projected solid angle times the radiance at its
// centre, from the MIP level of its solid angle.
//
// Spheres that overlap are counted more than once, so on a fitted set (50 overlapping spheres) the
// error is about 0.2 RMS; single or separate spheres are exact under a uniform sky.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/shadow_map.h"

namespace fastibl {

struct ShadowOptions {
  ShadowMethod method = ShadowMethod::cap_product;
  int resolution = 64;              // texels along an edge
  float extent = 0;                 // half the edge in metres; 0 = 3 × the spheres' half width
  std::optional<glm::vec2> centre;  // metres; by default the middle of the spheres
};

// Ratio of the light on the plane with and without the spheres, RGB in [0, 1], marker frame.
// plane_irradiance: E(z) of the same map. A channel of E(z) = 0 has ratio 1; a point in or on a
// sphere has 0; a sphere below the plane is ignored, one cut by it counts with the part above.
std::vector<glm::vec3> shadow_ratio(const CubeMap& radiance, glm::vec3 plane_irradiance,
                                    const SphereSet& spheres, std::span<const glm::vec2> points,
                                    ShadowMethod method = ShadowMethod::cap_product);

// The same at the texels of a map. Over the outer tenth of the map (distance along x or y from its
// centre) the ratio fades to exactly 1 at the border texels, so that a long shadow ends softly.
ShadowMap cast_shadow(const CubeMap& radiance, glm::vec3 plane_irradiance, const SphereSet& spheres,
                      const ShadowOptions& options = {});

}  // namespace fastibl
