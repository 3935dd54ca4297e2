// The object's colour (Eq. 3, 4 and 8).
#pragma once

#include <span>

#include "fastibl/core/image.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/object_layer.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

// Share of a lobe's light that reaches the eye: towards exponent 0, Lambert's law, it becomes that
// of diffuse light.
inline glm::vec3 glossy_share(const glm::vec4& share, const Material& m) {
  if (m.pbr || m.exponent >= 1) return glm::vec3(share.w);
  return glm::mix(glm::vec3(share), glm::vec3(share.w), m.exponent);
}

// L = emission + k_L · share · E/π + k_G · share · glossy, towards an eye (marker frame), with the
// fragment's shares (P_V and 1 in the paper). For a pbr material: emission + diffuse · share · E/π
// + reflectance · share · (average over the GGX lobe). Keeps pointers to what it is made from.
class SurfaceShading {
 public:
  SurfaceShading(const Material& material, const Lighting& lighting);
  // One colour for each fragment.
  void operator()(std::span<const Fragment> fragments, glm::vec3 eye,
                  std::span<glm::vec3> colours) const;

 private:
  // fragments: at most kBatch.
  void shade_batch(std::span<const Fragment> fragments, glm::vec3 eye,
                   std::span<glm::vec3> colours) const;

  const Material* material_;
  const Lighting* lighting_;
  GlossyShading glossy_;
  GgxShading ggx_;
};
ObjectLayer shade(std::span<const FragmentBand> bands, const Material& material,
                  const Lighting& lighting, glm::vec3 eye);

// Real objects in front of the virtual one, as a layer: the share of their light that is left,
// times coverage, and coverage.
ObjectLayer holdout_layer(std::span<const FragmentBand> bands);

}  // namespace fastibl
