// Equirectangular pictures: u = ½ + atan2(x, y)/2π, v = acos(z)/π. The top row is z = +1, the
// centre looks along +y, x grows to the right.
#pragma once

#include "fastibl/core/image.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

// Area-exact in both directions: each small piece of a pixel is carried with its exact solid angle
// to where it falls, so that the energy of each channel is kept and a constant stays constant.
// image: float RGB, linear. Throws for an empty picture, other than 3 channels, or size < 1.
CubeMap cubemap_from_equirect(ImageView<const float> image, int size);
// Picture of height × 2·height. Throws for height < 1.
Image<float> equirect_from_cubemap(const CubeMap& cube, int height);

}  // namespace fastibl
