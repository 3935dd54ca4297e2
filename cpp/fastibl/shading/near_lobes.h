// Near lights in the lobes of an object's vertices, where they are rather than where the map has
// them.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "fastibl/scene/material.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/light_sums.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {

class NearLobes {
 public:
  // shares: of the scene's directions. light: of the map, in their cells. mean_radiance: of the
  // map, by channel. Keeps references.
  NearLobes(const Scene& scene, const NearShares& shares, const CellLight& light,
            glm::vec3 mean_radiance, const LobeShape& lobe);

  // Of the cells of the light, without these lights.
  std::span<const float> flux() const { return flux_; }
  // Adds what the lobe of an entry sees of these lights. position, normal, view: mesh's frame, the
  // latter two unit.
  void add(std::size_t entry, glm::vec3 position, glm::vec3 normal, glm::vec3 view,
           LobeCells::Sums& sums) const;

 private:
  struct Light {
    glm::vec3 direction;  // from the map's centre, mesh's frame
    float inverse_distance, sin_radius, flux;
    const NearShares::OfLight* of;
  };
  std::vector<Light> lights_;
  std::vector<float> flux_;
  glm::vec3 centre_;  // of the map, mesh's frame
  LobeHeight height_;
};

}  // namespace fastibl
