// The picture that a person sees: the back picture, its shadow, and the object over it.
#pragma once

#include <cstdint>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/object_layer.h"
#include "fastibl/scene/picture.h"
#include "fastibl/scene/shadow_look_up.h"

namespace fastibl {

// What a camera's pixels see and what their codes mean, worked out once.
struct PixelTable {
  Camera camera;
  ByteResponse response;
  // Directions (x, y, 1), camera frame; one for each pixel, row by row; NaN beyond the lens model.
  std::vector<float> x, y;
  std::vector<float> vignette;  // share of the light that reaches each pixel; empty: all
  explicit PixelTable(const Camera& c);
};

// Back picture × shadow ratio (or the gain of the plane, which may exceed 1), with the object over
// it, in linear light, encoded with the camera's response. Pixels without the object whose ratio is
// 1 keep their bytes. An empty picture counts as black. holdout: real objects, whose picture is
// multiplied by their own ratio, not the plane's.
Image<std::uint8_t> composite(const Picture& back, double exposure, const PixelTable& table,
                              const Pose& camera_from_marker, const ObjectLayer& object,
                              const ShadowLookUp& shadow, const ObjectLayer& holdout = {});
// The same into an image, whose memory is used again.
void composite(const Picture& back, double exposure, const PixelTable& table,
               const Pose& camera_from_marker, const ObjectLayer& object,
               const ShadowLookUp& shadow, const ObjectLayer& holdout, Image<std::uint8_t>& out);

// The picture with nothing over it; transparent, of the camera's size, where there is none.
void bare_picture(const Picture& back, const Camera& camera, Image<std::uint8_t>& out);

// Object and shadow without a picture behind them: straight (not premultiplied) encoded RGB and
// alpha. A shadow is black with alpha 1 − ratio (Rec. 709 luminance; 0 where that is negative).
Image<std::uint8_t> matte(double exposure, const PixelTable& table, const Pose& camera_from_marker,
                          const ObjectLayer& object, const ShadowLookUp& shadow,
                          const ObjectLayer& holdout = {});

// The layers that `composite` puts together, as floats for another program to do the same: back
// picture × ratio × (1 − object's alpha) + object, in linear light, where 1 is the white of the
// camera's response.
struct PictureLayers {
  Image<float> object;  // RGB times coverage, and coverage
  Image<float> ratio;   // RGB: may exceed 1 where the object brightens the plane
};
PictureLayers picture_layers(double exposure, const PixelTable& table,
                             const Pose& camera_from_marker, const ObjectLayer& object,
                             const ShadowLookUp& shadow, const ObjectLayer& holdout = {});

}  // namespace fastibl
