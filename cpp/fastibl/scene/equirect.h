// Equirectangular pictures: u = ½ + atan2(x, y)/2π, v = acos(z)/π. The top row is z = +1, the
// centre looks along +y, x grows to the right.
#pragma once

#include "fastibl/core/image.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

enum class EquirectFilter {
  area,   // each texel the mean over its solid angle: the energy of each channel is kept
  point,  // one bilinear look-up for each texel: faster, for pictures about as fine as the map
};

// A constant stays constant. image: float RGB, linear; cleaned as a map is. Throws for an empty
// picture, other than 3 channels, or size < 1.
CubeMap cubemap_from_equirect(ImageView<const float> image, int size,
                              EquirectFilter filter = EquirectFilter::area);
// Area-exact: small pieces of pixels are carried with their exact solid angle.
// Picture of height × 2·height. Throws for height < 1.
Image<float> equirect_from_cubemap(const CubeMap& cube, int height);

}  // namespace fastibl
