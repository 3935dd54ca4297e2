// The glossy light that an object keeps from itself, by rays at every pixel.
#pragma once

#include <array>
#include <span>

#include "fastibl/scene/bvh.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/rasterize.h"

namespace fastibl {

inline constexpr int kTracedRays = 128;  // of a place

// A place on a triangle, one frame for all of it.
struct TrianglePlace {
  struct Corner {
    glm::vec3 position, normal;  // unit, on the side that is seen
    glm::vec3 origin;            // of its rays, but an offset
  };
  std::array<Corner, 3> corners;
  glm::vec3 weights;           // of the corners
  glm::vec3 position, normal;  // unit, on the side that is seen
};
// Where rays start: on the round surface that the normals are of, not on flat triangles, which
// their own neighbours hide: Hanika 2021, Hacking the Shadow Terminator. The corners' own origins
// are on it.
glm::vec3 ray_start(const TrianglePlace& place, float offset);

// Share of the glossy light of a map that is free, by rays from `start` along the taps of
// lobe_taps(): Σ free taps / Σ all of weight × radiance, radiance as the mean of its channels. 1
// where the lobe meets no light. map_from_bvh: rotation; the rest is in the frame of the bvh, unit.
float traced_share(const Bvh& bvh, const CubeMap& map, const glm::mat3& map_from_bvh,
                   const LobeShape& lobe, glm::vec3 start, glm::vec3 normal, glm::vec3 view);

// In place of the fragments' shares of their glossy light, as they come from glossy_shares(), where
// those tell of something in the lobe's reach. Nothing where the scene has no bvh. eye: marker
// frame.
void trace_shares(const Scene& scene, const CubeMap& map, glm::vec3 eye,
                  std::span<FragmentBand> bands);

}  // namespace fastibl
