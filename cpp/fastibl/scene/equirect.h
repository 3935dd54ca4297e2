// Equirectangular pictures: u = ½ + atan2(x, y)/2π, v = acos(z)/π. The top row is z = +1, the
// centre looks along +y, and x grows to the right.
#pragma once

#include "fastibl/core/image.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

enum class EquirectFilter {
  area,   // each texel the mean over its solid angle: the energy of each channel is kept
  point,  // one bilinear look-up for each texel: faster, for pictures about as fine as the map
};

// A constant picture becomes a constant map. image: float RGB, linear; it is cleaned as a map is.
// Throws for an empty picture, a number of channels other than 3, or size < 1.
CubeMap cubemap_from_equirect(ImageView<const float> image, int size,
                              EquirectFilter filter = EquirectFilter::area);
// Exact by area: small pieces of pixels are transferred with their exact solid angle. The picture
// has height × 2·height pixels. Throws for a height below 1, or above 8192 (2^27 pixels).
Image<float> equirect_from_cubemap(const CubeMap& cube, int height);

}  // namespace fastibl
