// A map as it is seen from a place beside its centre: near lights and walls are where they are.
#pragma once

#include <optional>
#include <span>

#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/lighting.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

// Borrows what it is given.
class SeenMap {
 public:
  // From the centre.
  SeenMap(const CubeMap& map) : map_(&map) {}
  // place: marker frame; null: the centre.
  SeenMap(const Lighting& lighting, const std::optional<WallsAround>& walls,
          const glm::vec3* place);

  int size() const { return map_->size(); }
  // Mean over about this solid angle around a unit direction. texel_share: how much of a look-up
  // finer than a texel reads the texel itself and not the blend between texels.
  glm::vec3 mean(glm::vec3 direction, float solid_angle, float texel_share) const;
  // What a mirror shows.
  glm::vec3 sample(glm::vec3 direction) const { return mean(direction, 0, 0); }

 private:
  glm::vec3 of_near_lights(glm::vec3 direction, float solid_angle, float texel_share) const;

  const CubeMap* map_;
  const CubeMap* near_ = nullptr;  // what near lights send, as the map has it
  std::span<const NearLight> lights_;
  const WallsAround* walls_ = nullptr;
  glm::vec3 offset_{0};  // from the centre
};

}  // namespace fastibl
