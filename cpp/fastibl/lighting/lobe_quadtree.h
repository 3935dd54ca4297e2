// The texels of all levels of a cube as a quadtree, from which each lobe picks the coarsest texels
// that keep the error: texels far from the lobe's middle, and in smooth parts of the map, stand for
// many.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "fastibl/lighting/lobe.h"
#include "fastibl/scene/cube_map.h"

namespace fastibl {

struct QuadtreeLevel {
  int size;
  const CubeLevel* radiance;
  float reach;  // largest angle between a texel's middle and a corner
  // For the texels of one face (all faces are alike), in the face's frame (s, t, major axis): the
  // mean direction, (1 − its length²)/2, and the solid angle.
  std::vector<float> x, y, z, deficit, angle;
  // For all 6 n² texels the largest among the 48 images, in units of the map's mean radiance: the
  // effect that a texel's unevenness can have, √ω Σ ω |L − mean| over the finest texels below it,
  // times up to 8 where it is far above the mean; and its flux ω L, at least ω.
  std::vector<float> unevenness, flux;
};

// The levels of a map from the finest on, as long as four texels make one.
class CubeQuadtree {
 public:
  // The finest level has at least `finest` texels along an edge. They are pieces of the map's own
  // texels where the map has fewer, or not a power of two.
  CubeQuadtree(std::shared_ptr<const CubeMap> map, int finest);

  const CubeMap& map() const { return *map_; }
  const std::vector<QuadtreeLevel>& levels() const { return levels_; }

 private:
  std::shared_ptr<const CubeMap> map_;
  std::vector<QuadtreeLevel> levels_;
};

// Texels of one face of one level that a group of nearby directions sums over.
struct TexelRun {
  int level, face;
  std::size_t first, count;  // of TexelChoice::texels
};
struct TexelChoice {
  std::vector<TexelRun> runs;
  std::vector<std::uint32_t> texels;  // y n + x
};

struct ChoiceLimits {
  // A texel is cut in four while its unevenness could change a result by more than this share of
  // the map's mean radiance,
  float unevenness;
  // and left out where its flux cannot change a result by more than this share.
  float flux;
};
// For all directions within `spread` (an angle) of a unit direction.
TexelChoice choose_texels(const CubeQuadtree& tree, const LobeTable& lobe, glm::vec3 direction,
                          float spread, const ChoiceLimits& limits);

// A map of `size` in which each texel of the given one is an area of its value, in pieces: energy
// is kept.
CubeMap resampled(const CubeMap& map, int size);

}  // namespace fastibl
