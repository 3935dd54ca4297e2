// Colour of the object (Eq. 3, 4 and 8), and the picture that a person sees.
#pragma once

#include <span>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/object_layer.h"
#include "fastibl/scene/picture.h"
#include "fastibl/scene/shadow_look_up.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

// Share of a lobe's light that reaches the eye: towards exponent 0, Lambert's law, that of diffuse
// light.
inline glm::vec3 glossy_share(const glm::vec4& share, const Material& m) {
  if (m.pbr || m.exponent >= 1) return glm::vec3(share.w);
  return glm::mix(glm::vec3(share), glm::vec3(share.w), m.exponent);
}

// L = emission + k_L · share · E/π + k_G · share · glossy, towards an eye (marker frame), with the
// shares of the fragment (P_V and 1 in the paper); of a pbr material emission + diffuse · share ·
// E/π + reflectance · share · (average over the GGX lobe). Keeps pointers to what it is made of.
class SurfaceShading {
 public:
  SurfaceShading(const Material& material, const Lighting& lighting);
  // One colour a fragment.
  void operator()(std::span<const Fragment> fragments, glm::vec3 eye,
                  std::span<glm::vec3> colours) const;

 private:
  // Of at most kBatch.
  void shade_batch(std::span<const Fragment> fragments, glm::vec3 eye,
                   std::span<glm::vec3> colours) const;

  const Material* material_;
  const Lighting* lighting_;
  GlossyShading glossy_;
  GgxShading ggx_;
};
ObjectLayer shade(std::span<const FragmentBand> bands, const Material& material,
                  const Lighting& lighting, glm::vec3 eye);

// Real objects before the virtual one, as a layer: what is left of their light times coverage, and
// coverage.
ObjectLayer holdout_layer(std::span<const FragmentBand> bands);

// What the pixels of a camera see and mean, worked out once.
struct PixelTable {
  Camera camera;
  ByteResponse response;
  // Directions (x, y, 1), camera frame; one a pixel, row by row; NaN beyond the lens model.
  std::vector<float> x, y;
  std::vector<float> vignette;  // share of the light that reaches each pixel; empty: all
  explicit PixelTable(const Camera& c);
};

// Back picture × shadow ratio (or the gain of the plane, which may exceed 1), the object over it,
// in linear light, encoded with the camera's response. Pixels without object whose ratio is 1 keep
// their bytes. An empty picture gives black there. holdout: real objects, whose picture is
// multiplied by their own ratio, not the plane's.
Image<std::uint8_t> composite(const Picture& back, double exposure, const PixelTable& table,
                              const Pose& camera_from_marker, const ObjectLayer& object,
                              const ShadowLookUp& shadow, const ObjectLayer& holdout = {});

// Object and shadow without a picture behind: straight (not premultiplied) encoded RGB and alpha,
// where a shadow is black with alpha 1 − ratio (Rec. 709 luminance; 0 where that is negative).
Image<std::uint8_t> matte(double exposure, const PixelTable& table, const Pose& camera_from_marker,
                          const ObjectLayer& object, const ShadowLookUp& shadow,
                          const ObjectLayer& holdout = {});

}  // namespace fastibl
