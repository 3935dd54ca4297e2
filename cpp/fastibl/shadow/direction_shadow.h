// Shadow of spheres on the marker plane, exact where they overlap: each of K directions of light
// gives its share of the irradiance where no sphere stands in its way.
//
// Root mean square error of the ratio over ten lights and three objects: 0.0034 at K = 256, about
// 0.009 (64/K)^0.71; see bench/shadows.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "fastibl/core/image.h"
#include "fastibl/shadow/near_plane.h"
#include "fastibl/shadow/plane_bits.h"
#include "fastibl/shadow/shadow_options.h"
#include "fastibl/shadow/steady_light.h"

namespace fastibl {

// 1 − the sum of the shares whose bits are set: (size, size, 3), row 0 is y min. Shares as
// whole_shares() makes them: exactly 1 where no bit is set, exactly 0 where all are. Written into
// an image that is kept. fading: towards its border, as fade_border() does.
void sum_shares(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares,
                Image<float>& ratio, bool fading = false);

// Half the edge of a map around `grid` beyond which no ratio changes by more than 1/510, judged by
// the light that passes through the spheres' bounding sphere; at most kMostOuter times that of the
// grid. 0 where the grid itself is enough.
inline constexpr float kMostOuter = 8;
float outer_extent(std::span<const LightDirection> light, const SphereSet& spheres,
                   const PlaneGrid& grid, const NearPlane& near_plane = {});

// Casts the shadows of one object, frame by frame. The directions of light stay where they are, the
// bits of a pose are kept as long as the pose is, and when nothing changed nothing is done.
class DirectionShadow {
 public:
  explicit DirectionShadow(int directions = 256) : light_(directions) {}

  // A map that nobody else holds any more is overwritten. near_lights: of the map. The directions
  // of their light are points, and each light varies over the plane as from its middle.
  std::shared_ptr<const ShadowMap> cast(const CubeMap& radiance, const SphereSet& spheres,
                                        const ShadowOptions& options = {},
                                        const NearLights& near_lights = {});
  // The same for a mesh, marker frame.
  std::shared_ptr<const ShadowMap> cast(const CubeMap& radiance,
                                        std::shared_ptr<const ShadowTriangles> mesh,
                                        const ShadowOptions& options = {},
                                        const NearLights& near_lights = {});
  const SteadyLight& light() const { return light_; }

 private:
  std::shared_ptr<const ShadowMap> cast_again(const CubeMap& radiance, bool elsewhere,
                                              const SphereSet& spheres,
                                              const ShadowOptions& options,
                                              const NearLights& near_lights);
  void place(const SphereSet& spheres, const ShadowOptions& options);
  void make_bits();
  void cast_mesh(glm::vec3 direction, const PlaneGrid& grid, ShadowTriangles::Scratch& scratch,
                 PlaneBits& bits) const;
  void make_ratio();
  void sum_near(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares,
                const PlaneGrid& grid, Image<float>& ratio) const;
  void own_map();

  SteadyLight light_;
  SphereSet spheres_;  // for a mesh: at the corners of its box
  std::shared_ptr<const ShadowTriangles> mesh_;
  ShadowOptions options_;
  NearPlane near_;
  PlaneGrid inner_, outer_;
  std::vector<PlaneBits> inner_bits_, outer_bits_;  // for each direction; outer ones may be empty
  std::shared_ptr<ShadowMap> map_ = std::make_shared<ShadowMap>();
};

}  // namespace fastibl
