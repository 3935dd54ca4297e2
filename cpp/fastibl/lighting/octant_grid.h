// The texels of a cube map by octants: the seven mirror images of a texel in the coordinate planes
// are texels too, so sums over the sphere are sums over one octant of eight radiances each. Private
// to lighting.
#pragma once

#include <array>
#include <vector>

#include "fastibl/lighting/small_lights.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct OctantGrid {
  int size;                    // of the faces
  std::vector<float> x, y, z;  // unit directions of the texels' centres; none is negative
  std::vector<float> solid_angle;
  std::vector<float> half_width;  // of the texel, radians; mean of its two axes
  // Solid angle times 1, x y, y z, 3 z² − 1, x z, x² − y²: the even harmonics up to order 2.
  std::array<std::vector<float>, 6> even_harmonics;
  std::vector<float> projected;  // solid angle times z
  // The mirror images, counted from CubeLevel::face(0); bit 0 of the index mirrors x, 1 y, 2 z.
  std::array<std::vector<int>, 8> texels;
  std::vector<int> octant_texels;  // of which each of the cube's texels is an image, face by face
};

// Made once for each size and kept. An odd size has texels on the coordinate planes, which are
// their own mirror images: right for the places where sums are wanted, not for the texels that are
// summed.
const OctantGrid& octant_grid(int size);

// The radiance of a level, folded. Only its part that is even under w → −w is kept; the odd part
// acts on the irradiance only through `vector`, because max(c, 0) − max(−c, 0) = c.
struct FoldedMap {
  const OctantGrid* grid;
  // [sign pattern][channel][texel]. With L' the sum of a texel's radiance and its antipode's, for
  // an octant's texel and its images in x, y and z: L' ± L'x ± L'y ± L'z with the signs of kSigns.
  std::array<std::array<std::vector<float>, 3>, 4> radiance;
  std::vector<SmallLight> small_lights;  // whose light is taken out of the radiance
  std::array<glm::dvec3, 3> vector;      // ∫ L w dw: RGB of its x, y and z
};
// Signs of the images (itself, in x, in y, in z) in each pattern: the characters of the group that
// the mirror images form when antipodes count as one. The functions 1, yz, xz and xy have these
// symmetries.
inline constexpr int kSigns[4][4] = {{1, 1, 1, 1}, {1, 1, -1, -1}, {1, -1, 1, -1}, {1, -1, -1, 1}};
// For each of the eight images, that of the four which is the same or its antipode.
inline constexpr std::size_t kEvenImage[8] = {0, 1, 2, 3, 3, 2, 1, 0};

// Folds the level that is at most `size` wide. A level that is smaller than 16, or odd, has its
// texels cut so that the size is even and ≥ 16. The vector is summed over the 64² level; small
// lights are where finer levels have them.
FoldedMap fold(const CubeMap& radiance, int size);

}  // namespace fastibl
