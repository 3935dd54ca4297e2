// What methods give the samples of a scene: their colours, and the share of the light that the
// object leaves to each, (diffuse RGB, glossy).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "fastibl/plan/costs.h"
#include "fastibl/render/scene_samples.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/self_shadow.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {

// Colours of the first `count` samples under some light: with all of their diffuse light and
// nothing glossy, or the other way round.
std::vector<glm::vec3> sample_colours(const SceneSamples& samples, std::size_t count,
                                      const Material& material, const Lighting& lighting,
                                      glm::vec4 share);

// The shares by methods of self-shadowing, of the samples that are seen.
class SampleShares {
 public:
  // scene: that the samples are of. light: with its map, and an irradiance that shares are of; its
  // near lights are in the samples' frame. Keeps references to the samples and the light.
  SampleShares(const SceneSamples& samples, const Scene& scene, const Lighting& light);

  std::vector<glm::vec4> of(SelfShadowMethod method);
  const LightRays& rays() const { return rays_; }  // that the last `traced_lights` asked for

 private:
  using Shares = std::vector<glm::vec4>;
  void add_between(std::span<const glm::vec4> by_vertex, std::size_t view, Shares& shares) const;
  Shares of_vertices(Shares by_vertex, SharesOf of) const;
  Shares transfer();
  // They change what transfer() found.
  void by_pixel(Shares& shares) const;
  LightRays by_rays_to_lights(Shares& shares, bool diffuse) const;
  void by_rays(Shares& shares) const;
  // In the mesh's frame.
  FragmentPlace place_of(const SceneSamples::Surface& sample) const;
  EntryShares of_entries(Shares& all) const;  // all: kept there
  glm::vec3 in_mesh(glm::vec3 direction) const { return direction * samples_.turned; }
  glm::vec3 start(const SceneSamples::Surface& s) const {
    return in_mesh(s.start - glm::vec3(0, 0, samples_.lifted));
  }

  const SceneSamples& samples_;
  const Lighting& light_;
  Scene scene_;  // of the vertices that samples lie between
  CellLight cells_;
  NearShares near_;  // for methods that know directions, with what it changed at vertices
  std::vector<glm::vec3> near_changes_;
  Shares own_;  // of the vertices' irradiance, by the map alone
  Shares transfer_;
  LightRays rays_;
};

}  // namespace fastibl
