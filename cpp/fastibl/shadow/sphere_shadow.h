// Shadow of spheres on the marker plane z = 0 with one look-up for each sphere: the paper's method
// (section 3.3; its formulas are in its supplement, so these are our reading). Each sphere is a cap
// of the sky that blocks its projected solid angle times the radiance at its centre, from the MIP
// level of its solid angle.
//
// Spheres that overlap are counted more than once, so on a fitted set (50 overlapping spheres) the
// error is about 0.2 RMS; single or separate spheres are exact under a uniform sky.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/shadow_map.h"
#include "fastibl/shadow/direction_shadow.h"
#include "fastibl/shadow/shadow_options.h"

namespace fastibl {

// Ratio of the light on the plane with and without the spheres, RGB in [0, 1], marker frame.
// plane_irradiance: E(z) of the same map. The ratio is 1 in a channel of E(z) = 0, and 0 at a point
// in or on a sphere. A sphere below the plane is ignored; one cut by it counts with the part above.
std::vector<glm::vec3> shadow_ratio(const CubeMap& radiance, glm::vec3 plane_irradiance,
                                    const SphereSet& spheres, std::span<const glm::vec2> points,
                                    ShadowMethod method = ShadowMethod::cap_product);

// The same at the texels of a map, by any method, with nothing kept between calls: see
// DirectionShadow. A map without an outer one fades to exactly 1 over its outer tenth (distance
// along x or y from its centre), so that a long shadow ends softly. Only the caps read
// plane_irradiance.
ShadowMap cast_shadow(const CubeMap& radiance, glm::vec3 plane_irradiance, const SphereSet& spheres,
                      const ShadowOptions& options = {});

// The same for one object, frame by frame: what is still right of the last map stays.
class ShadowCaster {
 public:
  // near_lights: for the `directions` method; the caps take all light as distant.
  ShadowMap cast(const CubeMap& radiance, glm::vec3 plane_irradiance, const SphereSet& spheres,
                 const ShadowOptions& options = {}, const NearLights& near_lights = {});

 private:
  std::optional<DirectionShadow> directions_;
};

}  // namespace fastibl
