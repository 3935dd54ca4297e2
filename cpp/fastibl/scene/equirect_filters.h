// Two ways from an equirectangular picture to the texels of a cube map. Private to scene.
#pragma once

#include "fastibl/core/image.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

// One bilinear look-up for each texel; the picture wraps around at its left and right edges.
void resample_points(ImageView<const float> image, CubeLevel& faces);
// Each texel becomes the mean over its solid angle of the picture, which is taken as constant
// within a pixel.
void resample_areas(ImageView<const float> image, CubeLevel& faces);

}  // namespace fastibl
